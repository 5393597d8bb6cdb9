"""The fitted material on the page: a fit while it goes on, verification, two sessions compared, and how far behind the page is."""
import re, shutil, time

from playwright.sync_api import expect

from driven import LONG, LOOKS, Browser, check, judged, until

BEHIND_MS = 300

# When each frame's cell changed, by the clock that the journal has as well: page and daemon are on one machine.
WATCH_CELLS = """() => {
    window.changed = {};
    new MutationObserver((all) => all.forEach(({ target }) => {
        const at = /^station (\\d+), .*exposure (\\d+) /.exec(target.title ?? "");
        if (at && ["done", "again"].includes(target.className)) window.changed[`${at[1] - 1}/${at[2] - 1}`] ??= Date.now();
    })).observe(document.querySelector(".grid"), { subtree: true, attributes: true, attributeFilter: ["title"] });
}"""
# How far behind each update of a fit was shown, and how often its chart had changed.
WATCH_FIT = """() => {
    window.behind = [];
    window.steps = new Set();
    new MutationObserver(() => {
        const time = document.querySelector("#view").dataset.fit?.split(" ")[1];
        if (!time) return;
        window.behind.push(Date.now() - Date.parse(time));
        window.steps.add(document.querySelector(".steps .now")?.textContent);
    }).observe(document.querySelector("#view"), { attributes: true, attributeFilter: ["data-fit"] });
}"""


def frames_are_shown_soon(page, daemon):
    """From the time a frame's record was written to the change of its cell, while the session runs."""
    page.goto(f"{daemon.url}/#/frames")
    expect(page.locator(".grid .done").first).to_be_visible()
    page.evaluate(WATCH_CELLS)
    already = daemon.session()["frames_committed"]
    while daemon.session()["frames_committed"] < already + 15:
        time.sleep(0.1)
    time.sleep(0.5)
    changed = page.evaluate("window.changed")
    committed = {f"{r['station']}/{r['exposure']}": r["time"] for r in daemon.events() if r["type"] == "frame.committed"}
    behind = [at - page.evaluate("text => Date.parse(text)", committed[cell]) for cell, at in changed.items() if cell in committed]
    check(f"{len(behind)} frames shown {max(behind, default=0):.0f} ms after their record at most, under {BEHIND_MS}",
          len(behind) >= 8 and max(behind) < BEHIND_MS, behind)
    page.goto(f"{daemon.url}/#/")
    expect(page.locator(".light-dome .done").first).to_be_visible()


def is_fitted_again(chromium, daemon):
    """The session's refit, watched: every update soon after it was made."""
    id = daemon.session()["id"]
    main, phone = (Browser(chromium, daemon.url, look) for look in ("desktop", "phone"))
    for browser in (main, phone):
        browser.open(f"fit/{id}")
        expect(browser.page.get_by_text("The fit has ended.")).to_be_visible()
    main.page.evaluate(WATCH_FIT)
    main.page.get_by_role("button", name="Fit again").click()
    until(main.page, "window.behind.length > 1 && document.querySelector('.fit-head [role=status]').textContent === 'The fit has ended.'")
    behind, steps = main.page.evaluate("window.behind"), main.page.evaluate("[...window.steps]")
    check(f"{len(behind)} updates of a refit shown {max(behind):.0f} ms after it at most, under {BEHIND_MS}", max(behind) < BEHIND_MS, behind)
    check("steps of the fit were seen", len(steps) > 1, steps)
    expect(main.page.locator(".chart .line").first).to_be_visible()
    expect(main.page.locator(".map rect").nth(100)).to_be_attached()
    check("the parameters have error bars", main.page.locator(".bar-chart .sigma").count() > 5)
    for browser in (main, phone):
        browser.open(f"fit/{id}")
        expect(browser.page.locator(".chart .line").first).to_be_visible()
        browser.picture("fit")
        judged(browser, "fit with a result")
    main.quiet("a fit, desktop")
    phone.quiet("a fit, phone")
    is_fitted_live(chromium, daemon)


def is_fitted_live(chromium, daemon):
    """A session's own fit, its stream open from the first frame on: no update is late. A release build is through in less than a
    tenth of a second, and the page, which asks again once an answer is shown, may then show the end alone; steps are looked for in the refit."""
    browser = Browser(chromium, daemon.url, "desktop")
    started = daemon.call("/v1/sessions", {"name": "marble ball, again"})
    page = browser.open(f"fit/{started['id']}")
    page.evaluate(WATCH_FIT)
    expect(page.get_by_text("The fit has ended.")).to_be_visible(timeout=LONG)
    behind = page.evaluate("window.behind")
    check(f"{len(behind)} updates of a session's fit shown {max(behind, default=0):.0f} ms after it at most, under {BEHIND_MS}",
          behind and max(behind) < BEHIND_MS, behind)
    browser.quiet("a session's fit")


def is_verified_and_compared(chromium, daemon):
    """Verified from the history, a damaged copy of a frame found and put right; two sessions side by side."""
    main, phone = (Browser(chromium, daemon.url, look) for look in ("desktop", "phone"))
    page = main.open("history")
    newest = daemon.session()
    until(page, "document.querySelectorAll('.history tbody tr').length >= 2")
    row = page.locator(".history tbody tr").first
    expect(row).to_contain_text("not verified")
    row.get_by_role("button", name=re.compile("Verify")).click()
    expect(row.locator(".sound")).to_be_visible(timeout=LONG)
    frame = daemon.folder / "data" / "sessions" / newest["id"] / "frames" / "003-03.jpg"
    aside = daemon.folder / "aside.jpg"
    shutil.copy(frame, aside)
    frame.write_bytes(aside.read_bytes()[:-1] + b"\0")
    row.get_by_role("button", name=re.compile("Verify")).click()
    expect(row.locator(".not_sound")).to_be_visible(timeout=LONG)
    expect(row).to_contain_text("003-03.jpg")
    shutil.copy(aside, frame)
    row.get_by_role("button", name=re.compile("Verify")).click()
    expect(row.locator(".sound")).to_be_visible(timeout=LONG)
    phone.open("history")
    expect(phone.page.locator(".sound").first).to_be_visible()
    for browser in (main, phone):
        browser.picture("history")
    page.get_by_role("button", name="Compare").click()
    main_and_phone = (main, phone)
    until(page, "location.hash.startsWith('#/compare/') && location.hash.length > 80")
    phone.open(page.evaluate("location.hash.slice(2)"))
    for browser in main_and_phone:
        expect(browser.page.get_by_text("Material 2 of the first, 2 of the second")).to_be_visible()
        expect(browser.page.locator("canvas")).to_have_count(2)
        until(browser.page, "[...document.querySelectorAll('figure img')].length === 2 && [...document.querySelectorAll('figure img')].every(i => i.naturalWidth > 0)")
        browser.picture("compare")
        judged(browser, "compare with two sessions")
    told = page.locator(".compared td:last-child").all_text_contents()
    check("the same ball twice: most parameters are within the errors", told.count("within the errors") > 8, told)
    main.quiet("history and compare, desktop")
    phone.quiet("history and compare, phone")


def other_colours_serve_as_well(chromium, daemon, views):
    """Each size in the colours it is not photographed in: axe once more, for contrast."""
    for look, (_, usual) in LOOKS.items():
        scheme = {"light": "dark", "dark": "light"}[usual]
        browser = Browser(chromium, daemon.url, look, scheme)
        for name, view in views.items():
            browser.open(view)
            browser.page.wait_for_timeout(400)
            judged(browser, f"{name} in {scheme}")
        browser.quiet(f"every view, {look} in {scheme}")
