#!/usr/bin/env python3
"""`rigd export --format merl` read from the definition of the format (Matusik et al. 2003): three int32, then one plane of float64 a
channel, scaled; cells by half angle (square root), difference angle and turn of the light about the half vector."""
import os, sys, tempfile
import numpy as np
from common import SCENES, agrees, ball, bilinear, brdf, export, loss, oracle, planes, tile, write_result

SCALE = np.array([1.0, 1.15, 1.66]) / 1500


def table(path):
    """Cells of 1/sr, half x difference x turn x channel."""
    assert os.path.getsize(path) == 12 + 3 * 90 * 90 * 180 * 8 == 34_992_012
    with open(path, "rb") as file:
        sizes = np.frombuffer(file.read(12), "<i4")
        values = np.frombuffer(file.read(), "<f8")
    assert list(sizes) == [90, 90, 180]
    return np.moveaxis(values.reshape(3, 90, 90, 180), 0, -1) * SCALE


def cell(n, l, v):
    """Indices of the cell of two directions, on vectors: the light turned into the frame of the half vector."""
    x = oracle.unit(np.cross(n, [1.0, 0, 0] if abs(n[0]) < 0.9 else [0, 1.0, 0]))
    frame = np.stack([x, np.cross(n, x), n])
    l, h = frame @ l, frame @ oracle.unit(l + v)
    half, about = np.arccos(min(1.0, h[2])), np.arctan2(h[1], h[0])
    turned = lambda w, axis, angle: (w * np.cos(angle) + axis * (axis @ w) * (1 - np.cos(angle)) + np.cross(axis, w) * np.sin(angle))
    d = turned(turned(l, np.array([0, 0, 1.0]), -about), np.array([0, 1.0, 0]), -half)
    difference, turn = np.arccos(min(1.0, d[2])), np.arctan2(d[1], d[0]) % np.pi
    return min(89, int(np.sqrt(half / (np.pi / 2)) * 90)), min(89, int(difference / (np.pi / 2) * 90)), min(179, int(turn / np.pi * 180))


def places(i, j, k):
    """Light and view, normal z, of eight places of a cell."""
    for a in (0.25, 0.75):
        for b in (0.25, 0.75):
            for c in (0.25, 0.75):
                half, difference, turn = ((i + a) / 90) ** 2 * np.pi / 2, (j + b) / 90 * np.pi / 2, (k + c) / 180 * np.pi
                h = np.array([np.sin(half), 0, np.cos(half)])
                d = np.array([np.sin(difference) * np.cos(turn), np.sin(difference) * np.sin(turn), np.cos(difference)])
                l = np.array([np.cos(half) * d[0] + np.sin(half) * d[2], d[1], np.cos(half) * d[2] - np.sin(half) * d[0]])
                yield l, 2 * (h @ l) * h - l


def check_cells(tables, model, materials):
    """Values of random cells against the independent script; nothing below the horizon."""
    rng, n, worst, below = np.random.default_rng(5), np.array([0, 0, 1.0]), 0.0, 0
    for _ in range(400):
        i, j, k = (int(rng.integers(size)) for size in (90, 90, 180))
        above = [(l, v) for l, v in places(i, j, k) if min(l[2], v[2]) > 0.01]
        for values, m in zip(tables, materials):
            found = values[i, j, k]
            if not above:
                assert (found == 0).all()
                below += 1
                continue
            wanted = np.mean([brdf(model, [m], [1.0], n, l, v) for l, v in above], axis=0)
            worst = max(worst, (np.abs(found - wanted) / wanted).max())
    assert worst < 1e-9 and below > 0, (worst, below)


def check(rigd, name):
    model, materials = SCENES[name]
    with tempfile.TemporaryDirectory() as folder:
        result, out, shape = (os.path.join(folder, part) for part in ("result", "out", "shape"))
        write_result(result, model, materials)
        told = export(rigd, result, "merl", out)
        texels = tile(rigd, result, os.path.join(folder, "exr"))
        weights = planes(os.path.join(out, "tile.exr"))
        tables = [table(os.path.join(out, f"material_{m + 1}.binary")) for m in range(len(materials))]
        check_cells(tables, model, materials)
        export(rigd, result, "mitsuba", shape)
        stack = np.stack([weights[f"weight.{m + 1}"] for m in range(len(materials))], axis=-1).astype(float)
        read = lambda n, l, v, uv: sum(w * t[cell(n, l, v)] for w, t in zip(bilinear(stack, *uv), tables))
        ours = lambda n, l, v, uv: brdf(model, materials, bilinear(texels, *uv), n, l, v)
        found = loss(ball(os.path.join(shape, "shape.ply"), v_up=False, count=1500), ours, read)
        agrees(f"merl, {len(materials)} materials of {model}", found, told, exact=False)


if __name__ == "__main__":
    for name in ("lambert", "ggx", "ward"):
        check(sys.argv[1], name)
