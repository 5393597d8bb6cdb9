#!/usr/bin/env python3
"""Reads reports of rigd with programs that know nothing of it: HTML by html5lib (strict), PDF by qpdf's own check (pikepdf) and by pypdf.
Both must say what report.json, material.json and journal.jsonl say, and make nothing of hostile names but text.

usage: check.py RIGD      exit status 0 when every check holds
"""
import json, math, re, shutil, subprocess, sys, tempfile
from pathlib import Path

import html5lib, pikepdf, pypdf

RIGD = Path(sys.argv[1]).resolve()
HOSTILE = "</title><script>alert('1')</script>\"><img src=x onerror=y> & \u202edlrow\x1b[31m (\\) 中😀 é"
failed = 0


def check(name, holds, detail=""):
    global failed
    failed += not holds
    print(("ok    " if holds else "FAIL  ") + name + (f"   [{detail}]" if detail and not holds else ""), flush=True)


def run(*arguments):
    return subprocess.run([RIGD, *map(str, arguments)], check=True, capture_output=True, text=True, timeout=300)


def percent(part):
    value = abs(100 * part)
    return f"{100 * part:.{1 if value >= 10 else 2 if value >= 0.1 else 3}f} %"


def words(text):
    """Without what lines and fonts do to a text."""
    return re.sub(r"\s+", "", text)


def read_html(path):
    """Texts, and whatever asks for something; strict: any error of the grammar of HTML is an exception."""
    parser = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False)
    tree = parser.parse(path.read_bytes().decode())
    tags = [element.tag if isinstance(element.tag, str) else "" for element in tree.iter()]
    asked = [(name, value) for e in tree.iter() for name, value in e.attrib.items()
             if (name if isinstance(name, str) else name[-1]) in ("src", "href", "srcset", "data", "action")]
    handlers = [name for e in tree.iter() for name in e.attrib if str(name).startswith("on")]
    return tree, tags, asked, handlers


def read_pdf(path):
    with pikepdf.open(path) as pdf:
        problems = pdf.check_pdf_syntax()
        active = [key for key in ("/OpenAction", "/AA") if key in pdf.Root]
        pictures = sum(isinstance(o, pikepdf.Stream) and o.get("/Subtype") == "/Image" for o in pdf.objects)
    reader = pypdf.PdfReader(path, strict=True)
    return problems, active, pictures, reader, "".join(page.extract_text() for page in reader.pages)


def judge(name, out, expected):
    """One report in both forms."""
    tree, tags, asked, handlers = read_html(out / "report.html")
    text = "".join(tree.itertext())
    check(f"{name}: HTML without script, frame, form", not {"script", "iframe", "form", "object", "embed", "link", "base"} & set(tags))
    check(f"{name}: HTML asks for nothing", all(v.startswith(("#", "data:image/png")) for _, v in asked), asked[:3])
    check(f"{name}: HTML has no handlers", not handlers, handlers)
    check(f"{name}: every picture and drawing is told in words",
          all(e.get("alt") for e in tree.iter("img")) and sum(t.endswith("svg") for t in tags) == sum(t.endswith("title") for t in tags) - 1)
    problems, active, pictures, reader, printed = read_pdf(out / "report.pdf")
    check(f"{name}: qpdf finds no fault in the PDF", not problems, problems)
    check(f"{name}: the PDF does nothing by itself", not active, active)
    check(f"{name}: the PDF has an outline, and no date", len(reader.outline) > 3 and "/CreationDate" not in reader.metadata)
    seen = {"HTML": words(text), "PDF": words(printed)}
    for what, value in expected:
        for form, all_of_it in seen.items():
            check(f"{name}: {form} has {what}", words(value) in all_of_it, value)
    headings = [e.text for e in tree.iter("h2")]
    check(f"{name}: sections of both are the same", headings == [item.title for item in reader.outline], headings)
    check(f"{name}: {pictures} pictures, as many in both", pictures == sum(t == "img" for t in tags))


def written(value, error):
    """Two digits of the standard error, as many decimals of the value."""
    if not error:
        return f"{value:.4f}"
    decimals = min(9, max(0, 1 - math.floor(math.log10(error))))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"


def expected(result):
    report, material = (json.loads((result / f"{name}.json").read_text()) for name in ("report", "material"))
    yield "the mean relative error", percent(report["mean_relative_error"])
    yield "points and samples", f"{report['pixels']}, {report['samples']}"
    for light in report["lights"]:
        yield f"the error of {light['image']}", f"{light['samples']}{percent(light['mean_relative_error'])}"
    for one in material["materials"]:
        for p in one["rho_d"] + one["rho_s"] + ([one["beta"]] if one["beta"] else []):
            if p["identified"] != "unidentified":
                yield f"a parameter, {p['value']}", written(p["value"], p["standard_error"])
    for warning in report["warnings"]:
        yield "a warning", warning


def journal(session):
    return [json.loads(line) for line in (session / "journal.jsonl").read_text().splitlines()]


def main():
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        run("demo", "--calibrate", "--scene", "wood", "--data", folder / "data")
        session, = folder.glob("data/*/sessions/*")
        run("report", session, "--out", folder / "a")
        run("report", session.parent.parent / session.name, "--out", folder / "b")
        for file in ("report.html", "report.pdf"):
            check(f"{file} is the same again", (folder / "a" / file).read_bytes() == (folder / "b" / file).read_bytes())
        records, manifest = journal(session), json.loads((session / "manifest.json").read_text())
        calibration = json.loads((session / "calibration.json").read_text())
        told = [("the sample", manifest["name"]), ("the id", manifest["id"]), ("the firmware", manifest["arm"]), ("the camera", manifest["camera"]),
                ("the program", manifest["software"]), ("frames", "70 of 70 planned"), ("the calibration", f"Calibration {calibration['version']} was made"),
                ("reprojection", f"{calibration['camera']['rms_px']:.3f} rms"), ("records", f"its last record ({len(records)})")]
        judge("calibrated session", folder / "a", [*told, *expected(session / "result")])

        run("fit", session, "--leave-out", "2,5", "--out", folder / "fit")
        run("report", folder / "fit", "--out", folder / "bare")
        judge("bare result", folder / "bare", [*expected(folder / "fit"), ("what is not known", "does not say how that was captured")])

        manifest |= {"name": HOSTILE, "arm": HOSTILE, "camera": HOSTILE, "software": HOSTILE}
        (session / "manifest.json").write_text(json.dumps(manifest))
        shutil.rmtree(session / "result")
        run("report", session, "--out", folder / "hostile")
        judge("hostile session", folder / "hostile", [("the name as text", "</title><script>alert('1')</script>"), ("the lack", "No material was fitted")])
        tree, *_ = read_html(folder / "hostile" / "report.html")
        check("hostile name: no control of the direction of reading", "\u202e" not in "".join(tree.itertext()))
    print(f"{failed} failed" if failed else "all hold")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
