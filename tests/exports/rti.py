#!/usr/bin/env python3
"""RTI: the shading of the ball says whence each picture is lit, as the list does, and the levels say what loss.json states."""
import json, subprocess, sys, tempfile, tomllib
from pathlib import Path
import numpy as np
import OpenEXR
from PIL import Image


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def check_directions(seen, usable, listed, normal):
    """Radiance = albedo x normal . direction: with the ball's true normals and albedos as the list has them on average, each picture by
    itself says whence it is lit. That agrees with the list but for the lamps being near, which moves them by up to 3 degrees."""
    shading = np.einsum("ld,yxd->lyx", listed, normal)
    albedo = np.where(usable, seen, 0).sum(0) / np.maximum(np.where(usable, shading, 0).sum(0), 1e-9)
    for light, direction in enumerate(listed):
        there = usable[light] & (usable.sum(0) >= 4)
        lit = (albedo[..., None] * normal)[there]
        found = unit(np.linalg.lstsq(lit, seen[light][there], rcond=None)[0])
        angle = np.degrees(np.arccos(found @ direction))
        print(f"  light {light}: {angle:.2f} degrees from the list by its shading, {there.sum()} pixels")
        assert there.sum() > 1000 and angle < 4.0


def check(session, out):
    told = tomllib.loads((session / "dataset.toml").read_text())
    camera, solid, lights = told["camera"], told["object"], told["light"]
    lines = (out / "rti.lp").read_text().splitlines()
    assert int(lines[0]) == len(lines) - 1 == len(lights)
    listed = [(line.split()[0], np.array(line.split()[1:], float)) for line in lines[1:]]
    beside = json.loads((out / "lights.json").read_text())
    stated = json.loads((out / "loss.json").read_text())["loss"]
    curves = np.array(json.loads((session / "calibration.json").read_text())["response"]["log_exposure"])
    # Rays of sight by the pinhole alone: the ball is small and in the middle, so distortion moves them by less than a pixel.
    focal, principal = np.array(camera["focal_px"]), np.array(camera["principal_px"])
    y, x = np.mgrid[0 : camera["height"], 0 : camera["width"]] + 0.5
    ray = unit(np.stack([(x - principal[0]) / focal[0], (y - principal[1]) / focal[1], np.ones_like(x)], -1))
    centre, radius = np.array(solid["center_mm"]), solid["radius_mm"]
    b = ray @ centre
    root = b * b - (centre @ centre - radius**2)
    on = root > 0
    point = (b - np.sqrt(np.where(on, root, 0)))[..., None] * ray
    normal = (point - centre) / radius
    difference, highlight, seen, usable_for = [], [], [], []
    for (name, direction), light, lamp in zip(listed, lights, beside["lights"]):
        assert name == lamp["file"] and abs(np.linalg.norm(direction) - 1) < 1e-6
        levels = np.asarray(Image.open(out / name)).astype(int)
        radiance = OpenEXR.File(str(session / light["image"]), separate_channels=True)
        window = radiance.header()["dataWindow"]
        (left, top), (right, bottom) = window
        frame = np.zeros(levels.shape)
        for c, channel in enumerate("RGB"):
            frame[top : bottom + 1, left : right + 1, c] = radiance.channels()[channel].pixels
        valid = np.zeros(levels.shape[:2], bool)
        valid[top : bottom + 1, left : right + 1] = radiance.channels()["valid"].pixels > 0
        to_light = unit(np.array(light["position_mm"]) - point)
        half = unit(to_light - ray)
        cos_half = np.sum(normal * half, -1)
        cos_i, cos_r = np.sum(normal * to_light, -1), np.sum(normal * -ray, -1)
        lit = on & valid & (cos_i > told["samples"]["cosine_cutoff"]) & (cos_r > told["samples"]["cosine_cutoff"])
        away = (np.array(light["position_mm"]) - centre) * [1, -1, -1]
        assert np.linalg.norm(np.array(lamp["position_mm"]) - away) < radius, "positions count from the surface, not from the camera"
        green = np.exp(curves[1][levels[..., 1]]) / beside["exposure_s"]
        seen.append(green)
        # Away from highlights the surface is nearly matt.
        usable_for.append(lit & (cos_half < np.cos(np.radians(25))) & (levels.max(-1) < 255))
        for c in range(3):
            recovered = np.exp(curves[c][levels[..., c]]) / (lamp["gain"] * beside["exposure_s"])
            usable = lit & (frame[..., c] > 0)
            part = np.abs(recovered - frame[..., c])[usable] / frame[..., c][usable]
            difference.append(part)
            highlight.append(part[cos_half[usable] > np.cos(np.radians(6))])
    check_directions(np.array(seen), np.array(usable_for), np.array([d for _, d in listed]), normal * [1, -1, -1])
    for key, parts in (("mean", difference), ("highlight", highlight)):
        value = np.concatenate(parts).mean()
        print(f"  {key}: {100 * value:.3f} % here, {100 * stated[key]:.3f} % stated")
        assert abs(value - stated[key]) < 0.05 * stated[key] + 1e-4


if __name__ == "__main__":
    rigd, result = sys.argv[1:3]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "export"
        subprocess.run([rigd, "export", result, "--format", "rti", "--out", out], check=True)
        check(Path(result).resolve().parent, out)
