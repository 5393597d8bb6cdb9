"""What drives the page in Chromium: checks that are counted, a window with everything its console complains of, and how a view is judged."""
import contextlib, io, os, re, shutil, time

from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import expect, sync_playwright

PHONE, DESKTOP = {"width": 390, "height": 844}, {"width": 1280, "height": 800}
LOOKS = {"phone": (PHONE, "dark"), "desktop": (DESKTOP, "light")}
PICTURE_BYTES = 150_000
LONG = 120_000      # ms, for what the rig takes its time for
expect.set_options(timeout=20_000)      # the page looks every 5 s

REACHABLE = """() => [...document.querySelectorAll('a[href], button, input, select, textarea, summary, [tabindex]')]
    .filter(e => !e.disabled && e.tabIndex >= 0 && e.checkVisibility() && !e.closest('dialog:not([open])')).length"""
AT = "() => { const e = document.activeElement; e.dataset.reached = 1; return document.querySelectorAll('[data-reached]').length }"


def check(name, holds, detail=""):
    print(("ok    " if holds else "FAIL  ") + name + (f"   [{detail}]" if detail and not holds else ""), flush=True)
    if not holds:
        check.failed += 1


check.failed = 0


def ended():
    """Says how the checks came out; the exit status."""
    print(f"{check.failed} checks failed" if check.failed else "all checks hold", flush=True)
    return 1 if check.failed else 0


@contextlib.contextmanager
def chromium():
    """Debian's Chromium, drawing with the processor alone; none where there is none."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not program:
        print("SKIPPED: no Chromium is installed (apt install chromium)")
        yield None
        return
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"] if os.geteuid() == 0 else [])
        yield launched
        launched.close()


def until(page, holds):
    """Waits until a script says so; Playwright's own way is eval in the page, which its Content-Security-Policy forbids."""
    end = time.monotonic() + LONG / 1000
    while not page.evaluate(holds):
        assert time.monotonic() < end, f"waited in vain for {holds}"
        time.sleep(0.1)


class Browser:
    """A page in a window of its own; whatever its console complains of is kept."""
    pictures, prefix = None, "page"

    def __init__(self, chromium, url, look, scheme=None):
        size, usual = LOOKS[look]
        scheme = scheme or usual
        self.context = chromium.new_context(viewport=size, color_scheme=scheme, locale="en-GB", reduced_motion="reduce")
        self.page, self.url, self.look, self.complaints = self.context.new_page(), url, look, []
        self.page.set_default_timeout(20_000)
        # A browser writes every answer of 400 and above and every lost connection on its console; those are told by the page as well.
        # That a pixel is read back from it, which a viewer's test does, the graphics driver calls slow.
        noise = re.compile("Failed to load resource|net::ERR_|GPU stall due to ReadPixels")
        self.page.on("console", lambda m: m.type in ("error", "warning") and not noise.search(m.text) and self.complaints.append(m.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda r: r.url.startswith((url, "blob:" + url)) or self.complaints.append("asked " + r.url))

    def open(self, view):
        self.page.goto(f"{self.url}/#/{view}")
        expect(self.page.locator("#view h2").first).to_be_visible()
        return self.page

    def picture(self, name):
        path = self.pictures / f"{self.prefix}-{name}-{self.look}.png"
        self.page.evaluate("scrollTo(0, 0)")
        shot = Image.open(io.BytesIO(self.page.screenshot(animations="disabled")))
        shot.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
        check(f"picture {path.name} is small", path.stat().st_size < PICTURE_BYTES, path.stat().st_size)

    def quiet(self, what):
        check(f"{what}: no complaint on the console", not self.complaints, self.complaints)
        self.context.close()


def judged(browser, name):
    """axe, the tab key and the width of one view as it stands."""
    page = browser.page
    found = [v for v in Axe().run(page).response["violations"] if v["impact"] in ("serious", "critical")]
    check(f"{name}, {browser.look}: axe finds nothing serious", not found, [(v["id"], v["nodes"][0]["html"][:120]) for v in found])
    check(f"{name}, {browser.look}: nothing is wider than the window", page.evaluate("document.documentElement.scrollWidth <= innerWidth"))
    wanted, reached = page.evaluate(REACHABLE), 0
    page.evaluate("document.activeElement.blur()")
    for _ in range(wanted + 5):
        page.keyboard.press("Tab")
        reached = page.evaluate(AT)
        if reached > wanted:
            break
    check(f"{name}, {browser.look}: the tab key reaches all", reached >= wanted, f"{reached} of {wanted}")
