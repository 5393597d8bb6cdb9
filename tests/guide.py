#!/usr/bin/env python3
"""Runs the guide: every command block of docs/guide/*.md with the simulated rig, and compares what is printed with what the pages show.

usage: guide.py RIGD [PAGE ...]      exit status 0 when every page holds

A block ```sh is run, a page from top to bottom in one shell in a directory of its own. ```sh daemon runs on beside the blocks after it.
```sh elsewhere needs hardware, root or a network and says so in its first line: only its rigd commands are looked for. Of a block ```text
after one that ran every line must be among what that printed, digits and ids aside; of ```json every key and all but the numbers.

`git clone` and `cargo run` of the quick start are played: they give this source tree and the program RIGD. Where the kernel allows it, all
runs in a network of its own, so that the port of the pages is free.
"""
import fcntl, json, os, re, shutil, signal, socket, struct, subprocess, sys, tempfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1]
GUIDE = SOURCE / "docs" / "guide"
PORT = 7040
LIMIT_S = 540
FENCE = re.compile(r"^```(\w*) ?(\w*)\n(.*?)^```$", re.M | re.S)
LINK = re.compile(r"\]\(([^)#\s]+)?(#[^)\s]*)?\)")


def check(name, holds, detail=""):
    print(("ok    " if holds else "FAIL  ") + name + (f"\n        {detail}" if detail and not holds else ""), flush=True)
    check.failed += not holds


check.failed = 0


def in_a_network_of_its_own():
    """This script again, where nobody else listens."""
    cut_off = ["unshare", "--user", "--map-root-user", "--net"]
    if "RIGD_GUIDE_ALONE" not in os.environ and subprocess.run([*cut_off, "true"], capture_output=True).returncode == 0:
        os.environ["RIGD_GUIDE_ALONE"] = "1"
        os.execvp(cut_off[0], [*cut_off, sys.executable, *sys.argv])
    if "RIGD_GUIDE_ALONE" in os.environ:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:      # what `ip link set lo up` does
            fcntl.ioctl(any_socket, 0x8914, struct.pack("16sH14x", b"lo", 0x1))
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", PORT)) == 0:
            sys.exit(f"guide.py: something listens on port {PORT}, which the guide uses: end it first")


def programs(folder, rigd):
    """`rigd`, and the two that the quick start has before there is one."""
    folder.mkdir()
    (folder / "rigd").symlink_to(rigd)
    played = {
        "cargo": f'case "$*" in "run --release -- "*) shift 3; exec {rigd} "$@";; *) echo "guide.py plays no cargo $*" >&2; exit 1;; esac',
        "git": f'mkdir "$3" && cd "$3" && for f in {SOURCE}/*; do case $f in */target|*/rigd-demo);; *) ln -s "$f" .;; esac; done',
    }
    for name, text in played.items():
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)


def script(blocks, said):
    """The blocks as one shell's; what each prints goes into files by its number."""
    lines = ["set -euo pipefail", "running=", "end() { [ -z \"$running\" ] || kill -INT $running 2>/dev/null || true; wait; }", "trap end EXIT"]
    for number, (kind, text) in enumerate(blocks):
        out, begun = f"{said}/{number}", f"{said}/begun"
        lines.append(f"echo {number} > {begun}")
        if kind == "daemon":
            command = " ".join(line for line in text.splitlines() if not line.startswith("#"))
            lines += [
                f"(exec {command}) > {out} 2>&1 &", "running=\"$running $!\"",
                f"until grep -q 'listening on\\|Ctrl-C ends it' {out}; do kill -0 $! || exit 1; sleep 0.1; done",
            ]
        elif kind == "":
            lines.append(f"{{\n{text}}} > {out} 2>&1")
    return "\n".join(lines) + "\n"


def bare(line):
    """A line without what differs from run to run."""
    line = re.sub(r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f-]{22}", "ID", line)
    line = re.sub(r"[0-9]+([.,:eE+-]+[0-9]+)*", "N", line)
    line = re.sub(r"[+-]N", "N", line)
    return re.sub(r"\s+", " ", line).strip()


def facts(value, path=""):
    """What a value says, each with the keys that lead to it, numbers by their key alone; lists by their first element."""
    if isinstance(value, dict):
        return {p for key, inner in value.items() for p in {f"{path}.{key}"} | facts(inner, f"{path}.{key}")}
    if isinstance(value, list):
        return facts(value[0], path) if value else set()
    if isinstance(value, (str, bool)):
        return {f"{path} is {bare(str(value))}"}
    return set()


def values(text):
    """The JSON values that a text holds, one after the other."""
    decoder, found, at = json.JSONDecoder(), [], 0
    while (start := text.find("{", at)) >= 0:
        try:
            value, at = decoder.raw_decode(text, start)
            found.append(value)
        except ValueError:
            at = start + 1
    return found


def shown(page, kind, text, printed, files):
    """Whether what the page shows is what was printed."""
    if kind == "text":
        lines = [bare(line) for line in printed.splitlines()]
        for line in text.splitlines():
            # A question whose answer is not echoed stands before it on the same line.
            check(f"{page}: prints {line.strip()[:60]!r}", any(one.endswith(bare(line)) for one in lines), printed[-1500:])
    elif kind == "json":
        known = set().union(*(facts(value) for value in values(printed) + files))
        for value in values(text):
            lacks = facts(value) - known
            check(f"{page}: answers {json.dumps(value)[:60]}", not lacks, f"lacks {lacks}")


def exists(rigd, line):
    """Whether the rigd command that a line holds is one."""
    words = re.search(r"\brigd((?: [a-z]+)+)", line)
    if not words or line.lstrip().startswith("#"):
        return True
    return subprocess.run([rigd, *words[1].split(), "--help"], capture_output=True).returncode == 0


def page_holds(page, rigd, folder):
    text = page.read_text()
    fences = FENCE.findall(text)
    for target, _ in LINK.findall(text):
        if target and not target.startswith("http"):
            check(f"{page.name}: {target} is there", (page.parent / target).exists())
    blocks = [(how, body) for language, how, body in fences if language == "sh"]
    for how, body in blocks:
        if how == "elsewhere":
            check(f"{page.name}: says why it is not run: {body.splitlines()[0][:50]}", body.startswith("# needs") or body.startswith("# in a clone"))
            check(f"{page.name}: its commands exist", all(exists(rigd, line) for line in body.splitlines()), body)
    if not any(how != "elsewhere" for how, _ in blocks):
        return
    work, said = folder / "work", folder / "said"
    work.mkdir(parents=True)
    said.mkdir()
    programs(folder / "bin", rigd)
    (folder / "run").write_text(script(blocks, said))
    environment = {**os.environ, "PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "LC_ALL": "C.UTF-8", "TERM": "dumb"}
    environment.pop("RIGD_TOKEN", None)
    # Enter, whenever somebody asks for it.
    enter = subprocess.Popen(["yes", ""], stdout=subprocess.PIPE)
    shell = subprocess.Popen(["bash", folder / "run"], cwd=work, env=environment, stdin=enter.stdout, stderr=subprocess.PIPE, text=True,
                             start_new_session=True)
    try:
        errors = shell.communicate(timeout=LIMIT_S)[1]
    except subprocess.TimeoutExpired:
        errors = f"not done after {LIMIT_S} s"
    finally:
        enter.kill()
        if shell.poll() is None:
            os.killpg(shell.pid, signal.SIGTERM)
            shell.wait()
    number = int((said / "begun").read_text())
    last = said / str(number)
    check(f"{page.name}: every command succeeds", shell.returncode == 0,
          f"the block\n{blocks[number][1]}ended with {shell.returncode}: {errors}{last.read_text()[-2000:] if last.exists() else ''}")
    files = [json.loads(file.read_text()) for file in work.glob("*.json")] if shell.returncode == 0 else []
    number = -1
    for language, how, body in fences:
        if language == "sh":
            number += 1
        elif number >= 0 and (said / str(number)).exists():
            shown(page.name, language, body, (said / str(number)).read_text(), files)


def main():
    if len(sys.argv) < 2 or not os.access(sys.argv[1], os.X_OK):
        sys.exit(f"{__doc__}\nguide.py: RIGD must be a program")
    in_a_network_of_its_own()
    missing = [name for name in ("curl", "jq") if not shutil.which(name)]
    if missing:
        sys.exit(f"guide.py: the guide uses {' and '.join(missing)}: install it")
    rigd, wanted = Path(sys.argv[1]).resolve(), sys.argv[2:]
    for page in sorted(GUIDE.glob("*.md")):
        if not wanted or page.name in wanted:
            with tempfile.TemporaryDirectory() as folder:
                page_holds(page, rigd, Path(folder))
    print(f"{check.failed} checks failed" if check.failed else "every page holds", flush=True)
    return 1 if check.failed else 0


if __name__ == "__main__":
    sys.exit(main())
