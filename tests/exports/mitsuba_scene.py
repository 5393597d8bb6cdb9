#!/usr/bin/env python3
"""`rigd export --format mitsuba` read by Mitsuba 3: its BRDFs against the independent script, its loss against the one told, and its
picture of a mesh against that of `rigd render`, on models that both have."""
import os, subprocess, sys, tempfile
import numpy as np
import mitsuba as mi
from common import PATCH, SCENES, agrees, ball, bilinear, brdf, export, loss, planes, tile, write_result

mi.set_variant("scalar_rgb")
# Pixels a side, and rays a pixel each way, of the pictures compared.
PIXELS, RAYS = 128, 8
BAR = 0.005


def evaluated(bsdf, n, l, v, uv):
    """BRDF per channel at a point whose shading frame is about n."""
    point = mi.SurfaceInteraction3f()
    point.sh_frame = mi.Frame3f(mi.Vector3f(*n))
    point.wi = point.sh_frame.to_local(mi.Vector3f(*v))
    point.uv = mi.Point2f(*uv)
    value = bsdf.eval(mi.BSDFContext(), point, point.sh_frame.to_local(mi.Vector3f(*l)))
    return np.array(value).ravel() / (n @ l)


def check_loss(rigd, name, exact):
    model, materials = SCENES[name]
    with tempfile.TemporaryDirectory() as folder:
        result, out = os.path.join(folder, "result"), os.path.join(folder, "out")
        write_result(result, model, materials)
        told = export(rigd, result, "mitsuba", out)
        texels = tile(rigd, result, os.path.join(folder, "exr"))
        scene = mi.load_file(os.path.join(out, "scene.xml"))
        bsdf = scene.shapes()[0].bsdf()
        points = ball(os.path.join(out, "shape.ply"), v_up=False, count=900)
        ours = lambda n, l, v, uv: brdf(model, materials, bilinear(texels, *uv), n, l, v)
        found = loss(points, ours, lambda n, l, v, uv: evaluated(bsdf, n, l, v, uv))
        agrees(f"mitsuba, {len(materials)} materials of {model}", found, told, exact)


def check_picture(rigd, name):
    model, materials = SCENES[name]
    with tempfile.TemporaryDirectory() as folder:
        result, out, picture = (os.path.join(folder, part) for part in ("result", "out", "picture"))
        write_result(result, model, materials)
        export(rigd, result, "mitsuba", out, "--mesh", "knot")
        size = f"{PIXELS}x{PIXELS}"
        subprocess.run([rigd, "render", result, "--mesh", "knot", "--out", picture, "--size", size, "--samples", str(RAYS),
                        "--patch", str(PATCH)], check=True, capture_output=True)
        ours = planes(os.path.join(picture, "render.exr"))
        ours = np.stack([ours[c] for c in "RGB"], axis=-1)
        path = os.path.join(out, "scene.xml")
        text = open(path).read()
        assert text.count('value="512"') == 2
        open(path, "w").write(text.replace('value="512"', f'value="{PIXELS}"'))
        theirs = np.array(mi.render(mi.load_file(path), spp=4 * RAYS * RAYS, seed=1))
        assert ours.shape == theirs.shape
        mean = np.abs(ours - theirs).mean() / ours.mean()
        print(f"mitsuba, picture of a knot of {model}: mean difference {100 * mean:.3f} % of the mean radiance, bar {100 * BAR} %; "
              f"sums differ by {100 * (theirs.sum() / ours.sum() - 1):+.3f} %")
        assert mean < BAR, mean


if __name__ == "__main__":
    check_loss(sys.argv[1], "lambert", exact=True)
    check_loss(sys.argv[1], "ggx", exact=True)
    check_loss(sys.argv[1], "ward", exact=False)
    check_loss(sys.argv[1], "cook-torrance", exact=False)
    check_picture(sys.argv[1], "lambert")
    check_picture(sys.argv[1], "ggx")
