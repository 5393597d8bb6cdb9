#!/usr/bin/env python3
"""Drives the page in Chromium against daemons of its own: plans and starts a session, watches it end, stops one, sees faults and what
became of them, a daemon that dies, tokens; looks at every view with axe, with the tab key, and takes its picture.

usage: page.py RIGD PICTURES      exit status 0 when every check holds
"""
import re, shutil, sys, tempfile, time
from pathlib import Path

from PIL import Image
from playwright.sync_api import expect

import material
from driven import LONG, LOOKS, Browser, check, chromium as started, ended, judged, until
from rigs import Arm, Daemon, calibrated, replayed, shipped, slower

RIGD, PICTURES = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
VIEWS = {"dashboard": "", "new": "new", "queue": "queue", "frames": "frames", "fit": "fit", "results": "results",
         "history": "history", "compare": "compare", "health": "health", "settings": "settings"}
KILOBYTES, PAINT_MS = 1500, 1000     # as they are sent: nothing is compressed


def is_light(chromium, url):
    browser = Browser(chromium, url, "phone")
    page = browser.open("")
    kilobytes = page.evaluate("[...performance.getEntriesByType('navigation'), ...performance.getEntriesByType('resource').filter(e => !/v1/.test(e.name))].reduce((sum, e) => sum + e.decodedBodySize, 0)") / 1000
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    check(f"the page weighs {kilobytes:.0f} kB, under {KILOBYTES}", 20 < kilobytes < KILOBYTES)
    check(f"first paint after {paint:.0f} ms, under {PAINT_MS}", paint < PAINT_MS)
    browser.quiet("an idle rig")


def is_planned_and_shot(chromium, daemon):
    """The wizard, a running session, its frames and its result; every view looked at on the way."""
    main, phone = (Browser(chromium, daemon.url, look) for look in ("desktop", "phone"))
    page = main.open("new")
    start = page.get_by_role("button", name="Start")
    expect(page.get_by_text("70 frames: 7 stations, 10 exposures each")).to_be_visible()
    expect(start).to_be_enabled()
    stations = page.get_by_label("Light stations, degrees")
    stations.fill("-55, 400, left")
    expect(page.locator(".field .wrong").filter(has_text="“left”: no number")).to_be_visible()
    check("a plan that is none cannot be started", start.is_disabled())
    stations.fill("-55, 400, -55")
    wrong = page.locator(".field .wrong").filter(has_text="station 2: 400 is outside")
    expect(wrong).to_contain_text("station 3: -55 repeats station 1")
    check("the field says that it is wrong", stations.get_attribute("aria-invalid") == "true")
    stations.fill("-55, -20, 15, 50")
    expect(page.get_by_text("40 frames: 4 stations, 10 exposures each")).to_be_visible()
    stations.fill("-55 -20 15 50 85 115 140")
    expect(page.get_by_text("70 frames")).to_be_visible()
    check("what is needed and checked stands before Start", page.locator(".preflight .check.good").count() >= 5)
    expect(page.locator(".dry")).to_contain_text(re.compile(r"needed, \S+\s[MGT]B free"))
    expect(page.locator(".dry")).to_contain_text(re.compile(r"Ends about\d\d:\d\d"))
    page.get_by_label("Name of the sample").fill("marble ball")
    for browser in (main, phone):
        if browser is phone:
            browser.open("new")
            expect(phone.page.get_by_text("70 frames")).to_be_visible()
        browser.picture("new")
    expect(start).to_be_enabled()
    start.click()
    expect(page.get_by_role("heading", name="marble ball")).to_be_visible()
    expect(page.locator(".light-dome .active")).to_be_visible(timeout=LONG)
    expect(page.locator(".light-dome .done").nth(2)).to_be_visible(timeout=LONG)
    last_frame_and_disk_are_told(page, daemon)
    busy_rig_is_told(main, daemon)
    material.frames_are_shown_soon(page, daemon)
    phone.open("")
    expect(phone.page.locator(".light-dome .active")).to_be_visible()
    lamp = phone.page.locator(".watch .lamp").bounding_box()
    check("dome and lamp are above the fold of a phone", lamp["y"] + lamp["height"] < phone.page.locator("#stopbar").bounding_box()["y"], lamp)
    expect(phone.page.locator(".last-frame canvas")).to_be_attached()
    for browser in (main, phone):
        browser.picture("dashboard")
    page.goto(f"{daemon.url}/#/frames")
    phone.open("frames")
    expect(page.locator(".grid .done").nth(25)).to_be_visible(timeout=LONG)
    page.locator(".grid .done").first.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Station 2, exposure 2")).to_be_visible()
    until(page, "document.querySelector('.chosen img')?.naturalWidth === 288")
    for browser in (main, phone):
        browser.picture("frames")
    page.goto(f"{daemon.url}/#/")
    expect(page.locator("#view .badge")).to_have_text("completed", timeout=LONG)
    expect(page.locator(".outcome img")).to_be_visible()
    expect(page.locator(".watch .verbs button:visible")).to_have_count(0)
    page.goto(f"{daemon.url}/#/nonsense")
    expect(page.get_by_role("heading", name="No such view")).to_be_visible()
    page.goto(f"{daemon.url}/#/frames")
    expect(page.locator(".grid .done")).to_have_count(70)
    check("every frame is on disk", len(daemon.session()["id"]) == 36 and daemon.session()["frames_committed"] == 70)
    for browser in (main, phone):
        browser.open(f"results/{daemon.session()['id']}")
        expect(browser.page.get_by_text("Material 2:")).to_be_visible()
        until(browser.page, "document.querySelector('figure img')?.naturalWidth > 0")
        browser.picture("results")
    main.quiet("a session from plan to result, desktop")
    phone.quiet("the same on a phone")


# The share of pixels with a channel at 255, by Pillow's decoder of the file on disk.
def clipped(file):
    levels = Image.open(file).convert("RGB").tobytes()
    return sum(255 in levels[i:i + 3] for i in range(0, len(levels), 3)) / (len(levels) / 3)


def last_frame_and_disk_are_told(page, daemon):
    """The last frame's picture, and how much of it is clipped, held against the file; the disk against the system's own figure."""
    page.goto(f"{daemon.url}/#/")
    canvas = page.locator(".last-frame canvas")
    expect(canvas).to_be_visible()
    check("the picture has the frame's shape", page.evaluate("(c => [c.width, c.height])(document.querySelector('.last-frame canvas'))") == [288, 192])
    expect(page.locator(".histogram rect")).to_have_count(64)
    label, told = page.evaluate("[document.querySelector('.last-frame canvas').getAttribute('aria-label'), document.querySelector('.clipped').textContent]")
    station, shutter = re.search(r"Station (\d+) .*, (\S+) s,", label).groups()
    record = next(r for r in daemon.events() if r["type"] == "frame.committed" and r["station"] == int(station) - 1 and r["shutter"] == shutter)
    true = 100 * clipped(daemon.folder / "data" / "sessions" / daemon.session()["id"] / "frames" / record["file"])
    shown = float(told.split("\xa0")[0])
    # Chromium's JPEG decoder and Pillow's may round a level of 254 and a half to either side.
    check(f"{shown} % of the last frame is clipped, {true:.2f} % by another decoder", abs(shown - true) < 0.5, label)
    disk = page.locator(".disk")
    expect(disk).to_contain_text(re.compile(r"needs up to \S+\s[kM]B more"))
    free, unit = re.search(r"Free(\S+)\xa0([MGT])B", disk.text_content()).groups()
    system = shutil.disk_usage(daemon.folder).free
    shown = float(free) * {"M": 1e6, "G": 1e9, "T": 1e12}[unit]
    check(f"{shown:.3g} bytes are free, {system:.3g} by the system", abs(shown / system - 1) < 0.1)
    expect(page.locator(".watch .lamp")).to_contain_text("not known: no reference patch tells")


def busy_rig_is_told(browser, daemon):
    """While something has the rig: not ready for a start, and the queue comes first."""
    page = browser.open("health")
    expect(page.get_by_text(re.compile(r"The rig is busy with marble ball( until about \d\d:\d\d)?"))).to_be_visible()
    expect(page.get_by_text("Ready: a session could start now.")).to_have_count(0)
    page = browser.open("new")
    expect(page.get_by_role("button", name="Put into the queue")).to_be_enabled()
    browser.open("")


def is_stopped(chromium, daemon):
    """Stop by the keyboard alone, abort with its one question."""
    browser = Browser(chromium, daemon.url, "desktop")
    page = browser.open("")
    daemon.start_session("to be stopped")
    expect(page.get_by_role("heading", name="to be stopped")).to_be_visible()
    expect(page.locator("#view .badge")).to_have_text("shooting", timeout=LONG)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    check("Stop is the second thing the tab key reaches", page.evaluate("document.activeElement.id") == "stop")
    page.keyboard.press("Enter")
    expect(page.locator("#stop")).to_have_text("Stopping …")
    expect(page.locator("#view .badge")).to_have_text(re.compile("stopped|failed"), timeout=LONG)
    expect(page.locator("#stop")).to_have_text("Stop")
    daemon.start_session("to be aborted")
    expect(page.locator("#view .badge")).to_have_text("shooting", timeout=LONG)
    page.get_by_role("button", name="Pause").click()
    expect(page.locator("#view .badge")).to_have_text("paused, lamp on", timeout=LONG)
    page.get_by_role("button", name="Resume").click()
    expect(page.locator("#view .badge")).to_have_text("shooting", timeout=LONG)
    page.get_by_role("button", name="Abort").click()
    page.keyboard.press("Escape")
    check("Escape leaves the session alone", daemon.session()["state"] == "running", daemon.session()["state"])
    page.get_by_role("button", name="Abort").click()
    page.locator("#yes").click()
    expect(page.locator("#view .badge")).to_have_text("aborted", timeout=LONG)
    browser.quiet("stop and abort")


def is_reported(chromium, daemon):
    """The report of the session is a page of its own: no script of ours, both looks."""
    for look in LOOKS:
        browser = Browser(chromium, daemon.url, look)
        browser.page.goto(f"{daemon.url}/v1/sessions/{daemon.session()['id']}/report")
        expect(browser.page.get_by_role("heading", name="The material")).to_be_visible()
        judged(browser, "report")
        browser.quiet("report")


def is_queued(chromium, daemon):
    main, phone = (Browser(chromium, daemon.url, look) for look in ("desktop", "phone"))
    for name in ("oak, second coat", "slate tile"):
        page = main.open("new/queue")
        expect(page.get_by_text("70 frames")).to_be_visible()
        page.get_by_label("Name of the sample").fill(name)
        page.get_by_label("Runs").fill("3")
        page.get_by_label("Minutes from start to start").fill("60")
        page.get_by_label("Not before").fill("2099-01-31T22:00")
        button = page.get_by_role("button", name="Put into the queue")
        expect(button).to_be_enabled()
        button.click()
        expect(page.get_by_role("heading", name=name)).to_be_visible()
        main.open("health")
    page, _ = main.open("queue"), phone.open("queue")
    for browser in (main, phone):
        expect(browser.page.get_by_role("heading", name="slate tile")).to_be_visible()
        browser.picture("queue")
    page.get_by_role("button", name="Make it the next: slate tile").click()
    expect(page.locator(".cards h3").first).to_have_text("slate tile")
    page.get_by_role("button", name="Hold the queue").click()
    expect(page.get_by_text("held by a user")).to_be_visible()
    page.get_by_role("button", name="Let it go on").click()
    expect(page.get_by_text("held by a user")).to_be_hidden()
    for name in ("slate tile", "oak, second coat"):
        page.get_by_role("button", name=f"Take it out: {name}").click()
        page.locator("#yes").click()
        expect(page.get_by_role("heading", name=name)).to_have_count(0)
    main.quiet("the queue, desktop")
    phone.quiet("the queue, phone")


def every_view_serves_everyone(chromium, daemon):
    for look in LOOKS:
        for name, view in VIEWS.items():
            browser = Browser(chromium, daemon.url, look)
            browser.open(view)
            browser.page.wait_for_timeout(800)
            if name == "health":
                expect(browser.page.get_by_text("Ready: a session could start now.")).to_be_visible()
                check("health shows its checks", browser.page.locator(".checks .check").count() == 8)
                expect(browser.page.locator(".log li").filter(has_text="frame.committed").first).to_be_attached()
                browser.picture("health")
            if name == "settings":
                expect(browser.page.get_by_text("plan.stations_deg")).to_be_visible()
                browser.picture("settings")
            judged(browser, name)
            browser.quiet(f"{name}, {look}")


def stop_outlasts_the_daemon(chromium, daemon):
    """The daemon dies; Stop is pressed; the next daemon takes the session up and hears it."""
    browser = Browser(chromium, daemon.url, "phone")
    page = browser.open("")
    daemon.start_session("left alone")
    expect(page.locator("#view .badge")).to_have_text("shooting", timeout=LONG)
    daemon.kill()
    expect(page.locator("#connection")).to_have_text("disconnected", timeout=LONG)
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.locator("#message")).to_contain_text("NOT reached")
    daemon.start()
    expect(page.locator("#view .badge")).to_have_text(re.compile("stopped|failed"), timeout=LONG)
    browser.quiet("a daemon that died")


def faults_are_told(chromium, folder, frames):
    """An arm that goes away and comes back; a frame that is the last one again, until the folder is put right."""
    arm = Arm(RIGD, folder)
    shelf = folder / "replayed"
    shutil.copytree(frames, shelf)
    with Daemon(RIGD, folder / "faulty", replayed(arm.link, shelf)) as daemon:
        main, phone = (Browser(chromium, daemon.url, look) for look in ("desktop", "phone"))
        page = main.open("")
        daemon.start_session("arm unplugged")
        # Between two brackets: a bracket shot again from a folder would be the same pictures again, which no camera makes.
        while daemon.session()["frames_committed"] % 20 or not daemon.session()["frames_committed"]:
            time.sleep(0.05)
        arm.unplug()
        expect(page.locator(".notes .fault").first).to_contain_text("arm: ", timeout=LONG)
        arm.plug()
        expect(page.locator(".notes .good").first).to_contain_text("arm: back", timeout=LONG)
        expect(page.locator("#view .badge")).to_have_text("completed", timeout=LONG)

        shutil.copy(frames / "003-03.jpg", shelf / "003-04.jpg")
        daemon.start_session("camera repeats itself")
        expect(page.get_by_role("heading", name="camera repeats itself")).to_be_visible(timeout=LONG)
        expect(page.locator("#view .badge")).to_have_text("interrupted", timeout=LONG)
        expect(page.locator(".notes .refused")).to_have_count(3)
        phone.open("")
        expect(phone.page.locator(".notes .refused")).to_have_count(3)
        for browser in (main, phone):
            browser.picture("fault")
        main.open("frames")
        expect(page.locator(".grid .refused")).to_have_count(1)
        shutil.copy(frames / "003-04.jpg", shelf / "003-04.jpg")
        main.open("")
        page.get_by_role("button", name="Resume").click()
        expect(page.locator("#view .badge")).to_have_text("completed", timeout=LONG)
        main.open("frames")
        expect(page.locator(".grid .again").first).to_be_visible()
        check("the frame that was refused was shot again", "exposure 5" in page.locator(".grid .again").last.get_attribute("title"))
        main.quiet("faults, desktop")
        phone.quiet("faults, phone")
    arm.unplug()


def calibration_is_led(chromium, daemon):
    """A calibration that waits: what it asks for, and its two buttons."""
    browser = Browser(chromium, daemon.url, "phone")
    page = browser.open("health")
    run = daemon.call("/v1/calibrations", {})
    expect(page.locator("#calibrating")).to_contain_text("waits for you", timeout=LONG)
    page.get_by_role("link", name="Go there").click()
    shoot = page.get_by_role("button", name="Shoot this step")
    expect(shoot).to_be_enabled()
    judged(browser, "a calibration that waits")
    browser.picture("calibration")
    shoot.click()
    expect(page.locator(".calibration li").first).to_be_visible(timeout=LONG)
    page.locator(".calibration").get_by_role("button", name="Abort").click()
    page.locator("#yes").click()
    expect(page.locator(".calibration")).to_be_hidden(timeout=LONG)
    check("it was aborted", daemon.call(f"/v1/calibrations/{run['id']}")["state"] == "aborted")
    browser.quiet("a calibration")


def weak_fit_is_marked(chromium, daemon):
    """A session stopped after two lights: its error never stands alone."""
    daemon.start_session("two lights of seven")
    while daemon.session()["stations_developed"] < 2:
        time.sleep(0.1)
    daemon.call(f"/v1/sessions/{daemon.session()['id']}/stop", {})
    while not daemon.session()["ended"]:
        time.sleep(0.1)
    session = daemon.session()
    browser = Browser(chromium, daemon.url, "desktop")
    page = browser.open("")
    if session["mean_relative_error"] is None:
        check("a session stopped after two lights is fitted", False, session)
    for view, box in (("", ".figures"), ("history", ".history tbody tr:first-child")):
        browser.open(view)
        expect(page.locator(f"{box} .weak-mark")).to_contain_text(f"from {session['stations_developed']} of 7 lights")
    fitted = [s["id"] for s in daemon.call("/v1/sessions")["sessions"] if s["mean_relative_error"] is not None]
    browser.open("compare")
    page.get_by_role("button", name="Compare").click()
    expect(page.locator(".compared").first).to_be_visible()
    expect(page.locator(".compared .weak-mark").first).to_be_visible()
    check("two sessions and more can be chosen", page.locator("form.verbs select").first.locator("option").count() == len(fitted))
    browser.quiet("a weak fit")


def tokens_are_asked_for(chromium, folder):
    read, control = "read-" + "0123456789abcdef" * 2, "ctrl-" + "0123456789abcdef" * 2
    file = folder / "tokens"
    file.write_text(f"read {read}\ncontrol {control}\n")
    file.chmod(0o600)
    with Daemon(RIGD, folder / "locked", shipped().replace('# tokens = "/etc/rigd/tokens"', f'tokens = "{file}"')) as daemon:
        browser = Browser(chromium, daemon.url, "desktop")
        browser.page.goto(daemon.url)
        browser.page.get_by_label("This daemon wants a token").fill(read)
        browser.page.keyboard.press("Enter")
        expect(browser.page.get_by_role("heading", name="No session yet")).to_be_visible()
        browser.open("new")
        expect(browser.page.get_by_text("this token may only read")).to_be_visible()
        browser.open("settings")
        expect(browser.page.get_by_role("row", name="2 control")).to_be_visible()
        text = browser.page.content()
        check("the settings show no token", read not in text and control not in text)
        browser.open("health")
        browser.page.get_by_role("button", name="Forget it").click()
        browser.page.get_by_label("This daemon wants a token").fill(control)
        browser.page.keyboard.press("Enter")
        expect(browser.page.get_by_role("button", name="Forget it")).to_be_visible()
        browser.open("new")
        expect(browser.page.get_by_text("70 frames")).to_be_visible()
        browser.quiet("tokens")


def main():
    PICTURES.mkdir(parents=True, exist_ok=True)
    Browser.pictures = PICTURES
    with tempfile.TemporaryDirectory() as folder, started() as chromium:
        if not chromium:
            return 0
        folder = Path(folder)
        with Daemon(RIGD, folder / "sound", slower(8)) as daemon:
            is_light(chromium, daemon.url)
            is_planned_and_shot(chromium, daemon)
            is_reported(chromium, daemon)
            frames = folder / "sound" / "data" / "sessions" / daemon.session()["id"] / "frames"
            material.is_fitted_again(chromium, daemon)
            material.is_verified_and_compared(chromium, daemon)
            every_view_serves_everyone(chromium, daemon)
            material.other_colours_serve_as_well(chromium, daemon, VIEWS)
            is_queued(chromium, daemon)
            is_stopped(chromium, daemon)
            weak_fit_is_marked(chromium, daemon)
            stop_outlasts_the_daemon(chromium, daemon)
        faults_are_told(chromium, folder, frames)
        with Daemon(RIGD, folder / "calibrated", calibrated()) as daemon:
            calibration_is_led(chromium, daemon)
        tokens_are_asked_for(chromium, folder)
    return ended()


if __name__ == "__main__":
    sys.exit(main())
