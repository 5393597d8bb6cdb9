"""The scene in which `rigd export` measures its losses, written anew for whole arrays of points: an analytic ball and numpy."""
import os, tempfile
import numpy as np
from common import HIGHLIGHT, LIGHTS_DEG, SCENES, bilinear, brdf, export, oracle, tile, write_result

PIXELS, FIELD_DEG, REPEATS = 128, 30.0, 2
POINTS = 15_000


def dot(a, b):
    return np.sum(a * b, axis=1)


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


class Points:
    """Points of the picture at random, lit: vectors, cosines (light, view, half, and difference: view and half vector), and places in the
    texture (tiles, v down)."""

    def __init__(self):
        half = np.tan(np.radians(FIELD_DEG) / 2)
        eye = 1.05 / np.sin(np.arctan(half)) * oracle.unit(np.array([0, 0.35, 1]))
        forward = -oracle.unit(eye)
        right = oracle.unit(np.cross(forward, [0, 1, 0]))
        down = np.cross(forward, right)
        y, x = np.mgrid[0:PIXELS, 0:PIXELS] + 0.5
        at = 2 * half / PIXELS * (np.stack([x, y], -1) - PIXELS / 2)
        ray = unit(forward + at[..., :1] * right + at[..., 1:] * down).reshape(-1, 3)
        root = (ray @ eye) ** 2 - (eye @ eye - 1)
        ray = ray[root > 0]
        normal = eye + (-(ray @ eye) - np.sqrt(root[root > 0]))[:, None] * ray
        parts = []
        for azimuth in np.radians(LIGHTS_DEG):
            rise = np.radians(20)
            light = np.array([np.cos(rise) * np.sin(azimuth), np.sin(rise), np.cos(rise) * np.cos(azimuth)])
            lit = (normal @ light > 0) & (dot(normal, -ray) > 0)
            parts.append((normal[lit], np.broadcast_to(light, normal[lit].shape), -ray[lit]))
        n, l, v = (np.concatenate(part) for part in zip(*parts))
        chosen = np.random.default_rng(5).choice(len(n), POINTS, replace=False)
        self.n, self.l, self.v = n, l, v = n[chosen], l[chosen], v[chosen]
        h = unit(l + v)
        self.light, self.view, self.half, self.difference = dot(n, l), dot(n, v), dot(n, h), dot(v, h)
        s, t = np.arctan2(n[:, 0], n[:, 2]) / (2 * np.pi), np.arccos(np.clip(n[:, 1], -1, 1)) / np.pi
        self.uv = REPEATS * np.stack([2 * s, t], 1)

    def ours(self, model, materials, texels):
        """Our BRDF by the independent script."""
        vectors = zip(self.n, self.l, self.v, self.uv)
        return np.array([brdf(model, materials, bilinear(texels, *uv), n, l, v) for n, l, v, uv in vectors])


def sample(picture, uv):
    """A picture (rows, columns, channels) at many places at once."""
    side = np.array(picture.shape[1::-1])
    place = np.mod(uv, 1) * side - 0.5
    low = np.floor(place).astype(int)
    part = (place - low)[:, :, None]
    at = lambda dx, dy: picture[(low[:, 1] + dy) % side[1], (low[:, 0] + dx) % side[0]]
    top = (1 - part[:, 0]) * at(0, 0) + part[:, 0] * at(1, 0)
    bottom = (1 - part[:, 0]) * at(0, 1) + part[:, 0] * at(1, 1)
    return (1 - part[:, 1]) * top + part[:, 1] * bottom


def from_srgb(coded):
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)


def trowbridge_reitz(alpha, p):
    return alpha**2 / (np.pi * (p.half**2 * (alpha**2 - 1) + 1) ** 2)


def smith_separable(alpha, p):
    """Visibility as glTF 2.0, appendix B, has it: masking over 4 (n.l) (n.v)."""
    side = lambda c: 1 / (c + np.sqrt(alpha**2 + (1 - alpha**2) * c**2))
    return side(p.light) * side(p.view)


def check_shape(positions, normals, corners, v):
    """The ball: radius 1, normals outwards, corners anticlockwise seen from outside, texture coordinates as on ours (v down)."""
    assert np.allclose(np.linalg.norm(positions, axis=1), 1, atol=1e-6) and np.allclose(positions, normals, atol=1e-6)
    p = positions[corners]
    assert (dot(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p.sum(axis=1)) > 0).all(), "a triangle is turned inside out"
    assert np.allclose(v, REPEATS * np.arccos(np.clip(positions[:, 1], -1, 1)) / np.pi, atol=2e-3)


def main(rigd, name, read):
    """Exports every scene to the format; `read` checks a folder of it and gives its BRDF at all points, which must differ from ours by
    what loss.json says: within a twentieth, for rigd's ball is of triangles and has all points."""
    for scene, (model, materials) in SCENES.items():
        with tempfile.TemporaryDirectory() as folder:
            result, out = os.path.join(folder, "result"), os.path.join(folder, "out")
            write_result(result, model, materials)
            told = export(rigd, result, name, out)["loss"]
            points = Points()
            ours = points.ours(model, materials, tile(rigd, result, os.path.join(folder, "exr")))
            difference = np.abs(read(out, points) - ours) / ours
            found = {"mean": difference.mean(), "highlight": difference[points.half > np.cos(HIGHLIGHT)].mean()}
            print(f"{name}, {len(materials)} materials of {scene}: " + "; ".join(
                f"{key} {100 * told[key]:.3f} % told, {100 * found[key]:.3f} % found" for key in found))
            assert abs(found["mean"] - told["mean"]) < 0.05 * told["mean"] + 1e-4
            assert abs(found["highlight"] - told["highlight"]) < 0.2 * told["highlight"] + 1e-4
