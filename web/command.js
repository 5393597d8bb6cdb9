// Commands that are typed in a terminal: with the real paths, and a button that copies them.
import { announce, ask } from "/api.js";
import { h } from "/show.js";

/// What `rigd export --format` takes (a test of the command line holds the list against it), a word each.
const FORMATS = {
  gltf: "glTF 2.0 binary, for any 3D viewer: a preview, one lobe a texel",
  usd: "USD with UsdPreviewSurface: a preview, one lobe a texel",
  materialx: "MaterialX: a standard_surface a material, mixed by the weights",
  mitsuba: "scene for Mitsuba 3",
  pbrt: "scene for pbrt-v4",
  merl: "MERL BRDF tables",
  exr: "OpenEXR maps and JSON parameters: every number of the result",
  rti: "a picture a light, for RTI programs",
  crate: "the whole session as RO-Crate in a BagIt bag, for an archive",
};

/// A word for the shell.
export const quoted = (word) => (/^[\w./+,:@%-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

/// Where the daemon keeps the result of a session, for a shell on its machine.
export async function resultOf(id) {
  const { settings } = await ask("/v1/settings");
  return quoted(`${settings.find((one) => one.key === "storage.data").value}/sessions/${id}/result`);
}

/// A browser lets no page use the clipboard that came over plain HTTP from another machine: there the command is marked, ready to be copied.
async function copy(code) {
  getSelection().selectAllChildren(code);
  const done = await navigator.clipboard?.writeText(code.textContent).then(() => true, () => false);
  announce(done ? "The command is copied." : "The command is marked: copy it with Ctrl C.");
  return done;
}

/// `code`, and the button beside it.
export function copied(code) {
  const button = h("button", { type: "button", onclick: async () => {
    button.textContent = (await copy(code)) ? "Copied" : "Marked: Ctrl C";
    setTimeout(() => (button.textContent = "Copy"), 3000);
  } }, "Copy");
  return h("div", { className: "command" }, code, button);
}

/// How a result gets into other programs.
export function exports(result) {
  const code = h("code", {});
  const format = h("select", { id: "export-format", onchange: () => show() }, Object.entries(FORMATS).map(([name, word]) => h("option", { value: name }, `${name}: ${word}`)));
  const show = () => (code.textContent = `rigd export --format ${format.value} ${result} --out export-${format.value}`);
  show();
  return h("section", {}, h("h3", {}, "Export to other programs"),
    h("div", { className: "field" }, h("label", { for: format.id }, "Format"), format), h("p", { className: "small" }, "In a terminal on the daemon's machine:"), copied(code));
}
