#!/usr/bin/env python3
"""USD: usd-core opens the stage and finds no fault in it, and its material reflects as loss.json says."""
import os, sys
import numpy as np
from PIL import Image
from pxr import Usd, UsdGeom, UsdShade, UsdValidation
import ball


def texture(surface, name):
    shader = UsdShade.Shader(surface.GetInput(name).GetConnectedSources()[0][0].source)
    get = lambda key: shader.GetInput(key).Get()
    assert shader.GetIdAttr().Get() == "UsdUVTexture" and get("wrapS") == get("wrapT") == "repeat"
    reader = UsdShade.Shader(shader.GetInput("st").GetConnectedSources()[0][0].source)
    assert reader.GetIdAttr().Get() == "UsdPrimvarReader_float2" and reader.GetInput("varname").Get() == "st"
    picture = np.asarray(Image.open(get("file").resolvedPath)) / 255.0
    picture = ball.from_srgb(picture) if get("sourceColorSpace") == "sRGB" else picture
    picture = picture if picture.ndim == 3 else picture[..., None]
    return picture * np.array(get("scale"))[: picture.shape[2]]


def read(out, points):
    path = os.path.join(out, "material.usda")
    stage = Usd.Stage.Open(path)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    # What belongs in a package (usdz) is no question of a stage of its own.
    context = UsdValidation.ValidationContext([v for v in validators if "Package" not in v.GetMetadata().name])
    faults = context.Validate(stage)
    assert len(validators) > 20 and not faults, [f.GetErrorAsString() for f in faults]
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Captured/Shape"))
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
    # USD's t runs up the picture, ours down.
    ball.check_shape(np.array(mesh.GetPointsAttr().Get()), np.array(mesh.GetNormalsAttr().Get()), corners, 1 - st[:, 1])
    surface = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0].ComputeSurfaceSource()[0]
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface" and surface.GetInput("useSpecularWorkflow").Get() == 1
    names = ("diffuseColor", "specularColor", "roughness")
    diffuse, f0, rough = (ball.sample(texture(surface, name), points.uv) for name in names)
    fresnel = f0 + (1 - f0) * ((1 - points.difference) ** 5)[:, None]
    alpha = rough[:, 0] ** 2
    lobe = ball.smith_separable(alpha, points) * ball.trowbridge_reitz(alpha, points)
    return (1 - fresnel) * diffuse / np.pi + fresnel * lobe[:, None]


if __name__ == "__main__":
    ball.main(sys.argv[1], "usd", read)
