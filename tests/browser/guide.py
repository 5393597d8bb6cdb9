#!/usr/bin/env python3
"""Takes the pictures of the guide and of the README: the demo's result on the page, as its printed link shows it.

usage: guide.py RIGD DOCS      writes DOCS/page.png and DOCS/guide/demo-{desktop,phone}.png; exit status 0 when the link leads to the result
"""
import io, os, re, shutil, signal, subprocess, sys, tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import expect, sync_playwright

RIGD, DOCS = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
LOOKS = {"desktop": ({"width": 1280, "height": 1500}, "light"), "phone": ({"width": 390, "height": 844}, "dark")}
LONG = 120_000      # ms
LINK = re.compile(r"^  marble +(http://\S+)$", re.M)


def taken(chromium, link, look, path):
    size, scheme = LOOKS[look]
    context = chromium.new_context(viewport=size, color_scheme=scheme, locale="en-GB", reduced_motion="reduce")
    page = context.new_page()
    page.goto(link)
    preview = page.locator("figure img")
    expect(preview).to_be_visible(timeout=LONG)
    expect(page.get_by_text("Material 2:")).to_be_visible()
    page.get_by_text("Mean relative error").first.scroll_into_view_if_needed()
    page.evaluate("scrollTo(0, 0)")
    shot = Image.open(io.BytesIO(page.screenshot(animations="disabled")))
    shot.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path} ({path.stat().st_size // 1000} kB)", flush=True)
    context.close()


def main():
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not program:
        print("SKIPPED: no Chromium is installed (apt install chromium)")
        return 0
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        command = [RIGD, "demo", "--scene", "marble", "--keep", "--data", folder]
        demo = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            said = ""
            for line in demo.stdout:
                said += line
                if line.startswith("Ctrl-C"):
                    break
            link = LINK.search(said)
            if not link:
                print(f"the demo printed no link:\n{said}")
                return 1
            chromium = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"] if os.geteuid() == 0 else [])
            for look in LOOKS:
                taken(chromium, link[1], look, DOCS / "guide" / f"demo-{look}.png")
            shutil.copy(DOCS / "guide" / "demo-desktop.png", DOCS / "page.png")
            chromium.close()
        finally:
            demo.send_signal(signal.SIGINT)
            demo.wait(60)
    return 0


if __name__ == "__main__":
    sys.exit(main())
