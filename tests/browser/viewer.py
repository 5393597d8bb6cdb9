#!/usr/bin/env python3
"""Holds the viewer against `rigd render` and `rigd relight`, for every reflection model, and drives it in Chromium: hands, keys, views, a mesh of
one's own, how many frames a second; looks at it with axe and the tab key, and takes its picture.

usage: viewer.py RIGD PICTURES      exit status 0 when every check holds
"""
import base64, io, json, math, random, shlex, shutil, subprocess, sys, tempfile, time, urllib.error, urllib.request
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import expect

from driven import LONG, Browser, check, chromium as started, ended, judged
from floats import difference, placed, read_exr, rgb, window
from rigs import Daemon, slower

RIGD, PICTURES = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
MODELS = ["lambert", "blinn-phong", "torrance-sparrow", "cook-torrance", "ward", "ward-duer", "lafortune", "ggx"]
SIZE = (320, 240)
VIEWS, PATCH = 20, 32
MOST = 0.01             # of the mean radiance, per view
FRAMES_A_SECOND = 15
KILOBYTES = 1500        # of everything, before compression

# A renderer of its own in the page, on the page's modules and the daemon's answers.
SETUP = """async ({ path, patch }) => {
    const [{ Renderer }, { readMesh, readMaps }] = await Promise.all([import("/viewer-gl.js"), import("/viewer-files.js")]);
    const renderer = new Renderer(document.createElement("canvas"));
    await renderer.setMaterial(await (await fetch(`${path}/texture?patch=${patch}`)).json());
    renderer.setResponse(await (await fetch(`${path}/response`)).json());
    window.relit = { renderer, readMesh, readMaps, path };
}"""
BASE64 = """const sent = (pixels) => new Promise((done) => {
        const reader = new FileReader();
        reader.onload = () => done(reader.result.split(",")[1]);
        reader.readAsDataURL(new Blob([pixels]));
    });"""
ON_MESH = """async ({ mesh, obj, scene, size }) => {
    """ + BASE64 + """
    const { renderer, readMesh } = window.relit;
    const answer = await (obj ? fetch("/v1/meshes", { method: "POST", headers: { "Content-Type": "model/obj" }, body: obj }) : fetch(`/v1/meshes/${mesh}`));
    renderer.setMesh({ ...readMesh(await answer.arrayBuffer()), closed: !obj });
    return sent(renderer.radiance(scene, ...size));
}"""
ON_OBJECT = """async ({ light, scene }) => {
    """ + BASE64 + """
    const { renderer, readMaps, path } = window.relit;
    const maps = async (name) => readMaps(await (await fetch(`${path}/surface${name}`)).arrayBuffer());
    const surface = await maps("");
    renderer.setObject(surface);
    renderer.setPhotograph(await maps(`/${light}`));
    const size = [surface.columns, surface.rows];
    return { size, fitted: await sent(renderer.radiance(scene, ...size)), measured: await sent(renderer.radiance({ ...scene, comparing: 1, line: 2 }, ...size)) };
}"""
# Counts the frames that a viewer draws, and their pixels: each clears its colours once.
COUNTED = """() => {
    const clear = WebGL2RenderingContext.prototype.clear;
    window.drawn = { frames: 0, columns: 0 };
    WebGL2RenderingContext.prototype.clear = function (bits) {
        if (bits & this.COLOR_BUFFER_BIT) {
            window.drawn.frames++;
            window.drawn.columns += this.canvas.width;
        }
        clear.call(this, bits);
    };
}"""


def unpacked(sent, size):
    return np.frombuffer(base64.b64decode(sent), "<f4").reshape(size[1], size[0], 4)


def around(rng, steepest):
    """A direction."""
    turn, rise = rng.uniform(0, 2 * math.pi), math.asin(rng.uniform(-1, 1) * math.sin(steepest))
    return np.array([math.cos(rise) * math.sin(turn), math.sin(rise), math.cos(rise) * math.cos(turn)])


def scenes():
    """Views spread over the meshes: cameras all around, near and far; every other light a lamp."""
    rng = random.Random(7)
    for i in range(VIEWS):
        eye = around(rng, 1.3)
        light = eye + 0.9 * around(rng, 1.5)
        light = light / np.linalg.norm(light)
        lamp = i % 2 == 1
        away = rng.uniform(1.3, 4) if lamp else 1
        bright = [rng.uniform(0.5, 6) * (away ** 2 if lamp else 1) for _ in range(3)]
        yield {
            "mesh": ["sphere", "cylinder", "knot"][i % 3],
            "scene": {
                "light": [*(away * light), 1 if lamp else 0], "strength": bright, "seconds": 2, "alone": -1, "showing": "radiance", "weight": 0, "most": 1,
                "eye": list(rng.uniform(2.2, 5) * eye), "middle": [rng.uniform(-0.15, 0.15) for _ in range(3)], "field": rng.uniform(20, 40),
                "repeats": rng.randint(1, 3), "shadow": 4096,
            },
        }


def listed(v):
    return ",".join(repr(float(x)) for x in v)


def render(result, mesh, scene, middle, radius, out):
    """What `rigd render` makes of a scene: radiance, and where the mesh is."""
    place = lambda v: listed(middle + radius * np.array(v))
    if scene["light"][3]:
        light = [f"--light-position={place(scene['light'][:3])}", "--intensity=" + listed(np.array(scene["strength"]) * radius ** 2)]
    else:
        light = ["--light-direction=" + listed(scene["light"][:3]), "--irradiance=" + listed(scene["strength"])]
    command = [RIGD, "render", result, "--mesh", mesh, "--out", out, "--patch", PATCH, "--repeats", scene["repeats"], f"--camera={place(scene['eye'])}",
               f"--look-at={place(scene['middle'])}", "--field", scene["field"], "--size", f"{SIZE[0]}x{SIZE[1]}", *light]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    planes, _ = read_exr(out / "render.exr")
    return rgb(planes), planes["valid"] > 0


def get(url):
    with urllib.request.urlopen(url, timeout=60) as answer:
        return answer.read()


def ring():
    """A ring of quadrilaterals without normals or texture coordinates, far from the origin, as OBJ."""
    around, about, lines, faces = 60, 30, [], []
    for i in range(around):
        for j in range(about):
            s, t = 2 * math.pi * i / around, 2 * math.pi * j / about
            out = 30 + 10 * math.cos(t)
            lines.append(f"v {1000 + out * math.cos(s):.6f} {-500 + out * math.sin(s):.6f} {10 * math.sin(t):.6f}")
            corner = lambda k, l: (k % around) * about + l % about + 1
            faces.append(f"f {corner(i, j)} {corner(i + 1, j)} {corner(i + 1, j + 1)} {corner(i, j + 1)}")
    return "\n".join(lines + faces) + "\n"


def fitted(daemon, id, model, keep):
    """Fits the session with a model; a copy of its result."""
    result = daemon.folder / "data" / "sessions" / id / "result"
    report = result / "report.json"
    was = report.stat().st_mtime_ns
    # With a lobe: left-out lights may find that a model is better off without, which is Lambert's.
    lobe = "none" if model == "lambert" else "coloured"
    daemon.call(f"/v1/sessions/{id}/fit", {"model": model, "materials": 2, "lobe": lobe})
    end = time.monotonic() + LONG / 1000
    while not report.exists() or report.stat().st_mtime_ns == was:
        assert time.monotonic() < end, f"no fit with {model}"
        time.sleep(0.1)
    assert json.loads((result / "material.json").read_text())["model"] == model
    return shutil.copytree(result, keep / model)


def shades_as_fitted(chromium, daemon, id, folder):
    """Every model on every view against `rigd render`, on the object against `rigd relight`; what was measured is what is in the files."""
    session = daemon.folder / "data" / "sessions" / id
    meshes = {name: placed(get(f"{daemon.url}/v1/meshes/{name}")) for name in ("sphere", "cylinder", "knot")}
    check("the knot has its 70 000 triangles", meshes["knot"][2] == 70_000, meshes["knot"][2])
    for model in MODELS:
        result = fitted(daemon, id, model, folder)
        browser = Browser(chromium, daemon.url, "desktop")
        page = browser.open("health")
        page.evaluate(SETUP, {"path": f"/v1/sessions/{id}", "patch": PATCH})
        apart = []
        for view in scenes():
            drawn = unpacked(page.evaluate(ON_MESH, {**view, "size": SIZE}), SIZE)
            told, valid = render(result, view["mesh"], view["scene"], *meshes[view["mesh"]][:2], folder / "picture")
            seen = valid | (drawn[..., 3] > 0)
            assert seen.mean() > 0.05 and told[seen].mean() > 0
            apart.append(difference(drawn[..., :3], told, seen))
        worst = max(range(VIEWS), key=lambda i: apart[i])
        check(f"{model}: {VIEWS} views differ from rigd render by {np.mean(apart):.3%} in the mean, {apart[worst]:.3%} at most", apart[worst] <= MOST,
              f"view {worst}")
        is_relit(page, model, result, session, folder)
        if model == "ggx":
            own_mesh_is_shaded(page, result, folder)
        browser.quiet(model)


def is_relit(page, model, result, session, folder):
    out = folder / f"relit-{model}"
    subprocess.run([RIGD, "relight", result, "--lights", session, "--out", out], check=True, stdout=subprocess.DEVNULL)
    lights = json.loads(get(f"{page.url.split('/#')[0]}/v1/sessions/{session.name}/lights"))["lights"]
    exr = folder / "surface.exr"
    exr.write_bytes(get(f"{page.url.split('/#')[0]}/v1/sessions/{session.name}/surface"))
    column, row, step = window(read_exr(exr)[1])
    for light in (1, 4):
        one = lights[light]
        scene = {"object": True, "light": [*one["position_mm"], 1], "strength": one["intensity"], "seconds": 2, "alone": -1, "showing": "radiance", "weight": 0,
                 "most": 1, "comparing": 0, "line": 0}
        drawn = page.evaluate(ON_OBJECT, {"light": light, "scene": scene})
        size = drawn["size"]
        cut = lambda image: image[row::step, column::step][:size[1], :size[0]]
        told = cut(rgb(read_exr(out / f"{light:03}.exr")[0]))
        apart = difference(unpacked(drawn["fitted"], size)[..., :3], told, told.sum(-1) > 0)
        check(f"{model}, light {light}: the object differs from rigd relight by {apart:.1e}", apart <= 0.001)
        measured, _ = read_exr(session / "radiance" / f"{light:02}.exr")
        valid, shown = cut(measured["valid"]) > 0, unpacked(drawn["measured"], size)
        check(f"{model}, light {light}: what was measured is shown as it is", valid.any() and np.array_equal(shown[..., :3][valid], cut(rgb(measured))[valid])
              and not shown[..., 3][~valid].any())


def own_mesh_is_shaded(page, result, folder):
    path = folder / "ring.obj"
    path.write_text(ring())
    base = page.url.split("/#")[0]
    request = urllib.request.Request(base + "/v1/meshes", path.read_bytes(), {"content-type": "model/obj"})
    middle, radius, triangles = placed(urllib.request.urlopen(request, timeout=60).read())
    check("the ring has its triangles", triangles == 3600, triangles)
    view = next(scenes())
    drawn = unpacked(page.evaluate(ON_MESH, {**view, "obj": ring(), "size": SIZE}), SIZE)
    told, valid = render(result, path, view["scene"], middle, radius, folder / "picture")
    apart = difference(drawn[..., :3], told, valid | (drawn[..., 3] > 0))
    check(f"a mesh of one's own, projected, far from the origin, differs by {apart:.3%}", apart <= MOST)
    request = urllib.request.Request(base + "/v1/meshes", b"#" * (33 << 20), {"content-type": "model/obj"})
    try:
        status = urllib.request.urlopen(request, timeout=60).status
    except urllib.error.HTTPError as error:
        status = error.code
    except urllib.error.URLError:
        status = "broken off while it was sent"
    check("a mesh of 33 MiB is refused", status in (413, "broken off while it was sent"), status)


def is_quick(chromium, daemon, id):
    """Drags over a picture of 1280 x 720 points for some seconds: frames that were drawn, each waited for, and how many columns they had. Without a
    graphics card they have fewer than 1280 while something moves, as docs/viewer.md says."""
    browser = Browser(chromium, daemon.url, "desktop")
    page = browser.open(f"viewer/{id}")
    canvas = page.locator("canvas")
    expect(canvas).to_be_visible()
    canvas.evaluate("c => Object.assign(c.style, { position: 'fixed', inset: 0, width: '1280px', height: '720px', zIndex: 9 })")
    page.evaluate(COUNTED)
    for mesh in ("knot", "sphere"):
        page.get_by_label("On", exact=True).select_option(mesh)
        for moved in ("light", "camera"):
            page.get_by_label("Dragging turns").select_option(moved)
            best = max((dragged(page) for _ in range(3)), key=lambda one: one[0])
            drawn = "drawn in full" if best[1] == 1280 else f"of {best[1]:.0f} columns"
            check(f"{mesh}, {moved} dragged: {best[0]:.1f} frames a second at 1280 x 720, {drawn}", best[0] >= FRAMES_A_SECOND)
    page.wait_for_timeout(2000)
    check("what stands is drawn in full", page.evaluate("document.querySelector('canvas').width") == 1280)
    browser.quiet("frames a second")


def dragged(page, seconds=3):
    """Frames a second, and their mean columns, of a drag after its first half second."""
    page.mouse.move(300, 300)
    page.mouse.down()
    start, step, counted = time.monotonic(), 0, None
    while time.monotonic() - start < seconds:
        step += 1
        page.mouse.move(300 + 200 * math.sin(0.05 * step), 300 + 60 * math.cos(0.07 * step))
        if counted is None and time.monotonic() - start > 0.5:
            counted = (time.monotonic(), page.evaluate("({ ...window.drawn })"))
    now, drawn = time.monotonic(), page.evaluate("({ ...window.drawn })")
    page.mouse.up()
    page.wait_for_timeout(1000)
    frames = drawn["frames"] - counted[1]["frames"]
    return frames / (now - counted[0]), (drawn["columns"] - counted[1]["columns"]) / max(frames, 1)


def is_driven(chromium, daemon, id, folder):
    """From the result to the viewer, by hand and by key; what the command says is what is shown."""
    browsers = [Browser(chromium, daemon.url, look) for look in ("desktop", "phone")]
    main = browsers[0]
    page = main.open(f"results/{id}")
    page.get_by_role("link", name="Relight it").click()
    canvas, command = page.locator("canvas"), page.locator(".viewer code")
    expect(canvas).to_be_visible()
    page.get_by_text("The same by command").click()
    result = daemon.folder / "data" / "sessions" / id / "result"
    expect(command).to_contain_text(f"rigd render {result} --out picture --mesh knot")
    page.wait_for_timeout(500)
    shows_what_its_command_makes(page, daemon, id, folder)

    was = command.inner_text()
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 260, box["y"] + 230, steps=4)
    page.mouse.up()
    expect(command).not_to_have_text(was)
    dragged = command.inner_text()
    check("a drag turns the light, and the light alone", part(dragged, "--camera") == part(was, "--camera") and part(dragged, "--light-direction") != part(was, "--light-direction"))
    canvas.focus()
    page.keyboard.press("Shift+ArrowLeft")
    expect(command).not_to_have_text(dragged)
    keyed = command.inner_text()
    check("a key with Shift turns the camera alone", part(keyed, "--camera") != part(dragged, "--camera") and part(keyed, "--light-direction") == part(dragged, "--light-direction"))
    page.keyboard.press("+")
    expect(command).not_to_have_text(keyed)
    page.get_by_role("button", name="Light and camera back").click()
    expect(command).to_have_text(was)
    page.get_by_label("Light", exact=True).select_option("lamp")
    expect(command).to_contain_text("--light-position")
    page.get_by_label("Exposure").fill("-2")
    expect(command).to_contain_text("--exposure 0.25")
    page.wait_for_timeout(500)
    shows_what_its_command_makes(page, daemon, id, folder)
    page.get_by_label("Exposure").fill("1")
    page.get_by_label("Show").select_option("weight-0")
    expect(page.locator(".ramp .colours")).to_be_visible()
    check("a residual is offered on the object alone", page.locator("#viewer-show option[value=residual]").is_disabled())

    (folder / "broken.obj").write_text("v 1 2\nf 1 2 3\n")
    page.locator("#viewer-file").set_input_files(folder / "broken.obj")
    expect(page.locator("#viewer-file-error")).to_contain_text("broken.obj: ")
    check("a mesh that is refused is not named as if it were shown", page.locator("#viewer-file").input_value() == "")
    page.locator("#viewer-file").set_input_files(folder / "ring.obj")
    expect(command).to_contain_text("--mesh ring.obj")
    expect(page.locator("#viewer-file-error")).to_be_empty()

    for browser in browsers:
        browser.open("health")
        browser.open(f"viewer/{id}")
        expect(browser.page.locator("canvas")).to_be_visible()
        browser.page.wait_for_timeout(1500)
        browser.picture("knot")
        judged(browser, "viewer, knot")
        browser.page.get_by_label("On", exact=True).select_option("object")
        expect(browser.page.locator("canvas[data-surface=object]")).to_be_visible()
        browser.page.get_by_label("Light of the session").select_option("3")
        browser.page.wait_for_timeout(1500)
        compares_until_the_light_is_moved(browser.page)
        if browser.look == "desktop":
            browser.page.get_by_label("Compare with").select_option("2")
            browser.page.wait_for_timeout(500)
        browser.page.get_by_label("Exposure").fill("-2")
        browser.page.wait_for_timeout(500)
        browser.picture("object")
        judged(browser, "viewer, object")
        shown = {}
        for show in ("mixture", "alone-0", "weight-1", "residual", "sigma-0"):
            browser.page.get_by_label("Show").select_option(show)
            browser.page.wait_for_timeout(400)
            shown[show] = browser.page.locator("canvas").screenshot()
        check(f"{browser.look}: every view of the object differs", len(set(shown.values())) == len(shown))
    for browser in browsers:
        weight = browser.page.evaluate("performance.getEntriesByType('resource').filter(e => !/v1/.test(e.name)).reduce((sum, e) => sum + e.decodedBodySize, 0)") / 1000
        check(f"{browser.look}: page and viewer weigh {weight:.0f} kB", 80 < weight < KILOBYTES)
        browser.quiet(f"the viewer, {browser.look}")


def compares_until_the_light_is_moved(page):
    """Controls say what is shown; a drag at the line moves it, one elsewhere the light, which a button and the list of lights bring back."""
    canvas, moved = page.locator("canvas"), page.locator(".moved")
    check("a line is drawn at first, and the list says so", page.get_by_label("Compare with").input_value() == "1")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag(start, end):
        page.mouse.move(start, y)
        page.mouse.down()
        page.mouse.move(end, y, steps=4)
        page.mouse.up()

    drag(x + 3, x + 0.2 * box["width"])
    line = float(page.locator("#viewer-line").input_value())
    check("a drag at the line moves the line, not the light", abs(line - 0.7) < 0.02 and not moved.inner_text(), line)
    for back in ("button", "list"):
        drag(x - 0.3 * box["width"], x - 0.2 * box["width"])
        expect(moved).to_contain_text("moved by hand")
        check("a moved light is none of the session's", page.locator("#viewer-station").input_value() == "moved")
        if back == "button":
            page.get_by_role("button", name="The session's light back").click()
        else:
            page.locator("#viewer-station").select_option("3")
        expect(moved).to_be_empty()
        check(f"the {back} brings the light back", page.locator("#viewer-station").input_value() == "3")
    drag(x + 0.2 * box["width"], x)


def part(command, name):
    return next(word for word in command.split() if word.startswith(name))


def shows_what_its_command_makes(page, daemon, id, folder):
    """The picture on the screen against render.png of the command that the page tells; edges are smoother on the screen."""
    command = page.locator(".viewer code").inner_text()
    words = shlex.split(command.replace("--out picture", f"--out {folder / 'same'}"))
    subprocess.run([RIGD, *words[1:]], check=True, stdout=subprocess.DEVNULL)
    told = np.asarray(Image.open(folder / "same" / "render.png").convert("RGB")).astype(float)
    page.locator("canvas").evaluate("canvas => { canvas.style.borderRadius = 0; canvas.style.background = 'black'; }")
    shot = np.asarray(Image.open(io.BytesIO(page.locator("canvas").screenshot())).convert("RGB")).astype(float)
    shot = shot[:told.shape[0], :told.shape[1]]
    check("the picture on the screen has the size that its command says", shot.shape == told.shape, (shot.shape, told.shape))
    apart = np.abs(shot - told).max(-1)
    check(f"levels on the screen differ from render.png by {apart.mean():.2f} in the mean, by more than 3 at {(apart > 3).mean():.2%}", apart.mean() < 1 and (apart > 3).mean() < 0.05)


def main():
    PICTURES.mkdir(parents=True, exist_ok=True)
    Browser.pictures, Browser.prefix = PICTURES, "viewer"
    with tempfile.TemporaryDirectory() as folder, started() as chromium:
        if not chromium:
            return 0
        folder = Path(folder)
        with Daemon(RIGD, folder / "rig", slower(40)) as daemon:
            daemon.start_session("marble ball")
            end = time.monotonic() + LONG / 1000
            while (session := daemon.session())["state"] != "completed":
                assert time.monotonic() < end and session["state"] != "failed", session
                time.sleep(0.5)
            shades_as_fitted(chromium, daemon, session["id"], folder)
            is_quick(chromium, daemon, session["id"])
            is_driven(chromium, daemon, session["id"], folder)
    return ended()


if __name__ == "__main__":
    sys.exit(main())
