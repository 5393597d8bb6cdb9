#!/usr/bin/env python3
"""`rigd export --format exr` read by OpenEXR's own library: every map and number is the one of the result, bit by bit."""
import json, os, sys, tempfile
import numpy as np
from common import PATCH, SCENES, export, planes, write_result


def check(rigd, model, materials):
    with tempfile.TemporaryDirectory() as folder:
        result, out = os.path.join(folder, "result"), os.path.join(folder, "out")
        written = write_result(result, model, materials)
        told = export(rigd, result, "exr", out)
        assert told["loss"] is None
        found = planes(os.path.join(out, "maps.exr"))
        assert sorted(found) == sorted(written)
        for name, pixels in written.items():
            assert np.array_equal(found[name], pixels.astype(np.float32)), name
        place, seam = told["tile"], PATCH // 4
        x, y = place["column"] + seam, place["row"] + seam
        for name, pixels in planes(os.path.join(out, "tile.exr")).items():
            # Beyond what the seams take, the tile is a cut-out.
            cut = written[name][y:y + PATCH - seam, x:x + PATCH - seam]
            assert np.array_equal(pixels[seam:, seam:], cut), name
        given = json.load(open(os.path.join(result, "material.json")))
        parameters = json.load(open(os.path.join(out, "parameters.json")))
        assert parameters["model"] == given["model"] and parameters["gauge"] == given["gauge"]
        for a, b in zip(given["materials"], parameters["materials"], strict=True):
            for key in ("rho_d", "rho_s", "beta"):
                pairs = zip(a[key], b[key], strict=True) if isinstance(a[key], list) else [(a[key], b[key])]
                for x, y in pairs:
                    assert x is y is None or all(x[k] == y[k] for k in x), key
    print(f"exr, {len(materials)} materials of {model}: the very numbers")


if __name__ == "__main__":
    for name in ("lambert", "ggx"):
        check(sys.argv[1], *SCENES[name])
