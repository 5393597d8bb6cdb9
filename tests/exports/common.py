"""What the readers of exports share: results made here, `rigd export` run on them, and the BRDF of the independent script.

A result is written with OpenEXR's own library and zlib, so that no byte of it is rigd's.
"""
import json, os, struct, subprocess, sys, zlib
import numpy as np
import OpenEXR

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "oracle"))
import brdf as oracle  # noqa: E402

SIDE = 96
PATCH = 32
LIGHTS_DEG = (-75, -50, -25, 0, 25, 50, 75)
HIGHLIGHT = np.radians(6)


def planes(path):
    """Channels of an OpenEXR file, by name, as rows of float32."""
    part = OpenEXR.File(path, separate_channels=True)
    return {name: np.asarray(channel.pixels) for name, channel in part.channels().items()}


def write_planes(path, channels):
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: np.ascontiguousarray(p, np.float32) for name, p in channels.items()}).write(path)


def write_mask(path, mask):
    """An 8-bit grey PNG."""
    rows = b"".join(b"\0" + (255 * row.astype(np.uint8)).tobytes() for row in mask)
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", mask.shape[1], mask.shape[0], 8, 0, 0, 0, 0)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def material(rho_d, rho_s=None, beta=None):
    return {"rho_d": list(rho_d), "rho_s": [] if rho_s is None else list(rho_s), "beta": beta}


def write_result(folder, model, materials, seed=1):
    """A disc with smooth random weights of the materials, as `rigd fit --out` leaves it; returns the maps written."""
    os.makedirs(folder, exist_ok=True)
    rng = np.random.default_rng(seed)
    parameter = lambda value: {"value": value, "standard_error": rng.uniform(1e-4, 1e-2), "identified": "identified", "reason": None}
    said = [{"share": 1 / len(materials), "rho_d": [parameter(v) for v in m["rho_d"]], "rho_s": [parameter(v) for v in m["rho_s"]],
             "beta": None if m["beta"] is None else parameter(m["beta"])} for m in materials]
    description = {"format": 1, "model": model, "gauge": "max gamma = 1 per material", "materials": said, "size": [SIDE, SIDE],
                   "provenance": {"software": "a script", "images": [], "simulated": True, "calibration": None}}
    json.dump(description, open(os.path.join(folder, "material.json"), "w"))
    y, x = np.mgrid[:SIDE, :SIDE]
    inside = np.hypot(x - SIDE / 2 + 0.5, y - SIDE / 2 + 0.5) < 0.46 * SIDE
    maps = {"valid": inside}
    for m in range(len(materials)):
        wave = sum(np.cos(rng.uniform(0.1, 0.5) * x + rng.uniform(0.1, 0.5) * y + rng.uniform(0, 7)) for _ in range(4))
        weight = np.where(inside, ((wave - wave.min()) / np.ptp(wave)) ** 2, 0).astype(np.float32)
        maps[f"weight.{m + 1}"] = weight / weight.max()
        maps[f"sigma.{m + 1}"] = np.where(inside, rng.uniform(0.001, 0.02, inside.shape), 0).astype(np.float32)
    maps["sigma.1"][SIDE // 2, SIDE // 2 - 30] = np.inf
    for c in "RGB":
        maps[f"residual.{c}"] = np.where(inside, rng.uniform(0, 0.1, inside.shape), 0).astype(np.float32)
    for kind, name in (("weight", "weights.exr"), ("sigma", "weights_sigma.exr")):
        write_planes(os.path.join(folder, name), {f"material_{m + 1}": maps[f"{kind}.{m + 1}"] for m in range(len(materials))})
    write_planes(os.path.join(folder, "residual.exr"), {c: maps[f"residual.{c}"] for c in "RGB"})
    write_mask(os.path.join(folder, "valid.png"), inside)
    return maps


def export(rigd, result, name, out, *more):
    """Runs `rigd export`; what it prints as JSON, which must agree with loss.json."""
    run = [rigd, "export", result, "--format", name, "--out", out, "--json", "--patch", str(PATCH), *more]
    told = json.loads(subprocess.run(run, check=True, capture_output=True, text=True).stdout)
    assert sorted(os.listdir(out)) == sorted(told["files"]), "files are there that were not told of, or missing"
    loss = json.load(open(os.path.join(out, "loss.json")))
    assert (told["loss"] or {"mean": 0.0})["mean"] == loss["mean_relative_difference"]
    return told


def tile(rigd, result, folder):
    """The tile's weights, rows x columns x materials, out of the export that holds the very numbers."""
    export(rigd, result, "exr", folder)
    maps = planes(os.path.join(folder, "tile.exr"))
    return np.stack([maps[f"weight.{m + 1}"] for m in range(len(maps))], axis=-1).astype(float)


def bilinear(texels, u, v):
    """Texels at texture coordinates, v down, repeated without end; their centres lie at +0.5."""
    rows, columns = texels.shape[:2]
    x, y = u * columns - 0.5, v * rows - 0.5
    left, top = int(np.floor(x)), int(np.floor(y))
    a, b = x - left, y - top
    at = lambda i, j: texels[j % rows, i % columns]
    return (1 - b) * ((1 - a) * at(left, top) + a * at(left + 1, top)) + b * ((1 - a) * at(left, top + 1) + a * at(left + 1, top + 1))


def brdf(model, materials, weights, n, l, v):
    """Ours, from the independent script, 1/sr per channel."""
    total = np.zeros(3)
    for m, weight in zip(materials, weights):
        total += weight * np.array(m["rho_d"]) / np.pi
        if m["beta"] is not None:
            total += weight * np.array(m["rho_s"]) * oracle.MODELS[model](n, l, v, m["beta"])
    return total


def ply(path):
    """Vertices as named columns, and triangles, of a binary PLY."""
    data = open(path, "rb").read()
    head, body = data.split(b"end_header\n", 1)
    lines = head.decode().split("\n")
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    names = [line.split()[2] for line in lines if line.startswith("property float")]
    count, faces = (int(line.split()[2]) for line in lines if line.startswith("element"))
    vertices = np.frombuffer(body, "<f4", count * len(names)).reshape(count, -1).astype(float)
    triangles = np.frombuffer(body[4 * vertices.size:], np.dtype([("n", "u1"), ("v", "<i4", 3)]))
    assert len(triangles) == faces and (triangles["n"] == 3).all()
    return {name: vertices[:, i] for i, name in enumerate(names)}, triangles["v"]


def ball(path, v_up, count=2500):
    """Points of an exported ball as rigd's camera sees it: normal, view, texture coordinates (v down); the chance of a point
    is what it covers of the picture."""
    vertices, triangles = ply(path)
    rng = np.random.default_rng(3)
    column = lambda *names: np.stack([vertices[name] for name in names], axis=-1)
    positions, normals, uv = column("x", "y", "z"), column("nx", "ny", "nz"), column("u", "v")
    corners = positions[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = np.einsum("ij,ij->i", faces, normals[triangles].sum(axis=1))
    assert (outward > 0).all(), "a triangle is turned inside out"
    eye = 1.05 / np.sin(np.radians(15)) * np.array([0, 0.35, 1]) / np.hypot(0.35, 1)
    away = eye - corners.mean(axis=1)
    covers = np.clip(np.einsum("ij,ij->i", faces, away), 0, None) / np.linalg.norm(away, axis=1) ** 3
    for t in rng.choice(len(triangles), count, p=covers / covers.sum()):
        a, b = sorted(rng.uniform(size=2))
        part = np.array([a, b - a, 1 - b])
        u, v = part @ uv[triangles[t]]
        n = oracle.unit(part @ normals[triangles[t]])
        view = oracle.unit(eye - part @ corners[t])
        if n @ view > 0:
            yield n, view, (u, 1 - v if v_up else v)


def loss(points, ours, theirs):
    """Mean relative difference of lit points and channels under the seven lights, and that of highlights, each with its standard
    error; the lights of one point count as one draw."""
    every, highlights = [], []
    for n, v, uv in points:
        at, bright = [], []
        for azimuth in np.radians(LIGHTS_DEG):
            rise = np.radians(20)
            l = np.array([np.cos(rise) * np.sin(azimuth), np.sin(rise), np.cos(rise) * np.cos(azimuth)])
            if n @ l <= 0:
                continue
            a = ours(n, l, v, uv)
            difference = np.abs(theirs(n, l, v, uv) - a) / a
            at.append(difference.mean())
            if np.arccos(min(1.0, n @ oracle.unit(l + v))) < HIGHLIGHT:
                bright.append(difference.mean())
        every.append(at)
        highlights.append(bright)
    return of_clusters(every), of_clusters(highlights)


def of_clusters(clusters):
    """Mean over all values, and its standard error by the clusters they come in."""
    sums, counts = (np.array([f(c) for c in clusters if c], float) for f in (sum, len))
    mean = sums.sum() / counts.sum()
    return mean, np.sqrt(((sums - mean * counts) ** 2).sum()) / counts.sum()


def agrees(what, found, told, exact):
    """Loss found here against loss told; an exact export has none but rounding, below 0.002 %."""
    (mean, error), (highlight, highlight_error) = found
    stated = told["loss"]
    print(f"{what}: told {100 * stated['mean']:.4f} %, highlights {100 * stated['highlight']:.4f} %; "
          f"found {100 * mean:.4f} +- {100 * error:.4f} %, {100 * highlight:.4f} +- {100 * highlight_error:.4f} %")
    if exact:
        assert mean < 2e-5 and stated["mean"] < 2e-5, what
    else:
        # Other points of the same ball, drawn at random: four standard errors of what was drawn.
        assert abs(mean - stated["mean"]) < 4 * error, what
        assert abs(highlight - stated["highlight"]) < 4 * highlight_error + 1e-6, what


SCENES = {
    "lambert": ("lambert", [material((0.6, 0.5, 0.4)), material((0.1, 0.3, 0.5))]),
    "ggx": ("ggx", [material((0.5, 0.4, 0.3), (0.03, 0.03, 0.03), 0.15), material((0.1, 0.2, 0.3), (0.08, 0.05, 0.02), 0.3),
                    material((0.3, 0.05, 0.05), (0.01, 0.01, 0.01), 0.08)]),
    "ward": ("ward", [material((0.63, 0.54, 0.4), (0.05, 0.05, 0.048), 0.0604), material((0.16, 0.23, 0.31), (0.03, 0.032, 0.035), 0.109)]),
    "cook-torrance": ("cook-torrance", [material((0.5, 0.4, 0.3), (0.04, 0.04, 0.04), 0.2), material((0.9, 0.8, 0.7), (0.02, 0.03, 0.04), 0.4)]),
}
