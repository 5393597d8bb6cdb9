"""Readers of their own for what rigd writes: OpenEXR (uncompressed, 32-bit floats) and .glb, as arrays."""
import json, re, struct

import numpy as np


def read_exr(path):
    """Channels by name, as large as the whole frame and 0 outside the data, and the text about them."""
    data = path.read_bytes()
    at, names, size, about = 8, [], {}, ""

    def text():
        nonlocal at
        end = data.index(b"\0", at)
        found, at = data[at:end].decode(), end + 1
        return found

    while name := text():
        kind, (length,) = text(), struct.unpack_from("<i", data, at)
        at += 4
        end = at + length
        if kind == "chlist":
            while data[at]:
                names.append(text())
                assert struct.unpack_from("<i", data, at)[0] == 2, "32-bit floats"
                at += 16
        elif name in ("dataWindow", "displayWindow"):
            size[name] = struct.unpack_from("<4i", data, at)
        elif name == "compression":
            assert data[at] == 0, "uncompressed"
        elif name == "rigd":
            about = data[at:end].decode()
        at = end
    (x, y, right, bottom), whole = size["dataWindow"], size["displayWindow"]
    rows, columns = bottom - y + 1, right - x + 1
    x, y = x - whole[0], y - whole[1]
    places = struct.unpack_from(f"<{rows}Q", data, at)
    planes = {name: np.zeros((whole[3] - whole[1] + 1, whole[2] - whole[0] + 1), np.float32) for name in names}
    for row, place in enumerate(places):
        values = np.frombuffer(data, "<f4", columns * len(names), place + 8).reshape(len(names), columns)
        for name, line in zip(names, values):
            planes[name][y + row, x:x + columns] = line
    return planes, about


def rgb(planes):
    return np.stack([planes[name] for name in "RGB"], -1)


def window(about):
    """First column and row, and the step, of a surface."""
    step, column, row = map(int, re.match(r"every (\d+)\. pixel.* column (\d+), row (\d+)", about).groups())
    return column, row, step


def placed(glb):
    """Middle and radius of a mesh in its own unit, and its number of triangles."""
    length, = struct.unpack_from("<I", glb, 12)
    told = json.loads(glb[20:20 + length])
    node, = told["nodes"]
    indices = told["accessors"][told["meshes"][0]["primitives"][0]["indices"]]
    return np.array(node["translation"]), node["scale"][0], indices["count"] // 3


def difference(a, b, seen):
    """Mean over the pixels that either sees, and over channels, of |a - b|, over the mean of b there."""
    return float(np.abs(a - b)[seen].mean() / b[seen].mean())
