#!/usr/bin/env python3
"""Crate: bagit validates the bag, rocrate reads the description, and the files are the session's, bit by bit."""
import hashlib, json, subprocess, sys, tempfile
from pathlib import Path
import bagit
from rocrate.rocrate import ROCrate


def check(session, out):
    bag = bagit.Bag(str(out))
    bag.validate()
    print(f"  bagit: valid, {len(bag.payload_entries())} files")
    crate = ROCrate(str(out / "data"))
    manifest = json.loads((session / "manifest.json").read_text())
    assert crate.root_dataset["identifier"] == "urn:uuid:" + manifest["id"]
    assert manifest["name"] in crate.name and crate.license["name"]
    described = {e.id: e for e in crate.data_entities}
    files = {str(p.relative_to(session)): p for p in session.rglob("*") if p.is_file() and not p.is_symlink()}
    assert {i for i in described if not i.endswith("/")} == set(files), set(files) ^ set(described)
    for name, path in files.items():
        data = (out / "data" / name).read_bytes()
        assert data == path.read_bytes(), name
        assert described[name]["sha256"] == hashlib.sha256(data).hexdigest() and int(described[name]["contentSize"]) == len(data)
    actions = {e["name"]: e for e in crate.contextual_entities if e.type == "CreateAction"}
    assert len(actions) == 2, actions
    capture = next(a for n, a in actions.items() if n.startswith("Capture"))
    assert capture["startTime"] == manifest["started"] and {i["name"] for i in capture["instrument"]} >= {"camera", "rigd"}
    # Every file is part of the whole, by its folders.
    reached, ahead = set(), [crate.root_dataset]
    while ahead:
        for part in ahead.pop().get("hasPart", []):
            if part.id not in reached:
                reached.add(part.id)
                ahead.append(part)
    assert reached >= set(files), set(files) - reached
    print(f"  rocrate: {len(described)} files and folders, {len(actions)} actions")


if __name__ == "__main__":
    rigd, result = sys.argv[1:3]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "export"
        subprocess.run([rigd, "export", result, "--format", "crate", "--out", out], check=True)
        check(Path(result).resolve().parent, out)
