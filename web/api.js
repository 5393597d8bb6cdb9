// Requests to the daemon: the token, refusals, and how long ago anything was heard.
import { $, h } from "/show.js";

/// When the daemon last answered or sent anything, and whether it cannot be reached.
export const line = { heard: Date.now(), lost: false };

/// Thrown when the daemon cannot be reached.
export class Unreachable extends Error {}

/// The token lives as long as the tab: in no file, no cookie, no address.
export const token = () => sessionStorage.getItem("token");
export function useToken(text) {
  if (text) sessionStorage.setItem("token", text);
  else sessionStorage.removeItem("token");
  location.reload();
}

/// Every request shows the token, if there is one; where it is missing or wrong, it is asked for.
export async function load(path, { headers, ...options } = {}) {
  const shown = token() ? { Authorization: `Bearer ${token()}` } : {};
  const answer = await fetch(path, { ...options, headers: { ...headers, ...shown } });
  $("login").hidden = answer.status !== 401;
  return answer;
}

export function reached() {
  line.heard = Date.now();
  line.lost = false;
}

function unreachable(error) {
  line.lost = true;
  throw new Unreachable(error.message);
}

/// What a request that was refused throws: the daemon's `problem` in words.
const refusal = (body, text) => Object.assign(new Error((body.reasons ?? [body.detail ?? text]).join("\n")), { problem: body });

/// The answer's JSON; an error with the daemon's `problem` if it refuses.
export async function ask(path, options) {
  const answer = await load(path, options).catch(unreachable);
  const text = await answer.text().catch(unreachable);
  reached();
  const body = /json/.test(answer.headers.get("content-type")) ? JSON.parse(text) : text;
  if (!answer.ok) throw refusal(body, text);
  return body;
}

/// The answer's bytes; refused as with `ask`.
export async function bytes(path, options) {
  const answer = await load(path, options).catch(unreachable);
  const told = await (answer.ok ? answer.arrayBuffer() : answer.json()).catch(unreachable);
  reached();
  if (!answer.ok) throw refusal(told, "refused");
  return told;
}

export const post = (path, body, headers = {}) => ask(path, body === undefined
  ? { method: "POST", headers }
  : { method: "POST", headers: { "Content-Type": "application/json", ...headers }, body: JSON.stringify(body) });

export function say(text) {
  $("message").textContent = text || "";
  $("message").hidden = !text;
}

/// Says something to who listens to the page instead of looking at it.
export function announce(text) {
  if ($("announced").textContent !== text) $("announced").textContent = text;
}

/// Runs work whose failure is either the daemon's refusal (shown) or a lost connection (shown by its age).
export async function attempt(work, refused = say) {
  try {
    return await work();
  } catch (error) {
    if (error.problem) refused(error.message, error.problem);
    else if (!(error instanceof Unreachable)) throw error;
  }
}

/// Address of a file's bytes, for a picture or a download; null if it cannot be had.
export async function blob(path) {
  const answer = await load(path);
  return answer.ok ? URL.createObjectURL(await answer.blob()) : null;
}

/// A link's own request shows no token: where one is needed, the file is loaded first.
export function link(name, path) {
  const save = async (event) => {
    event.preventDefault();
    const file = await blob(path);
    if (!file) return say(`${name} cannot be had now`);
    h("a", { href: file, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(file), 60000);
  };
  return h("a", token() ? { href: path, onclick: save } : { href: path }, name);
}

/// Reads a stream of events from `after` on, handing over each as JSON, and takes a broken stream up where it broke; the daemon's 204 after
/// the last event ends it. (EventSource cannot show a token.)
export async function follow(path, signal, take) {
  let last = 0;
  while (!signal.aborted) {
    try {
      const answer = await load(path, { headers: { "Last-Event-ID": String(last) }, signal });
      if (answer.status !== 200) return;
      const pieces = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (let piece = await pieces.read(); !piece.done; piece = await pieces.read()) {
        const events = (text + piece.value).split("\n\n");
        text = events.pop();
        reached();
        for (const event of events) {
          last = /^id: ?(\d+)$/m.exec(event)?.[1] ?? last;
          const data = /^data: ?(.*)$/m.exec(event)?.[1];
          if (data) take(JSON.parse(data));
        }
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof SyntaxError) throw error;
      line.lost = true;
    }
    await new Promise((later) => setTimeout(later, 1000));
  }
}
