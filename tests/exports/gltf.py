#!/usr/bin/env python3
"""glTF: Khronos's validator finds nothing, and a reader of our own makes of the file what loss.json says."""
import io, json, os, struct, subprocess, sys
import numpy as np
from PIL import Image
import ball

VALIDATE = """
const fs = require('fs'), validator = require(process.argv[1] + '/node_modules/gltf-validator');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2]))).then((r) => console.log(JSON.stringify(r)));
"""


def parse(path):
    """The description, and the bytes of each view."""
    data = open(path, "rb").read()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert magic == b"glTF" and version == 2 and length == len(data)
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    told = json.loads(data[20 : 20 + size])
    binary = data[20 + size + 8 :]
    return told, [binary[v["byteOffset"] :][: v["byteLength"]] for v in told["bufferViews"]]


def read(out, points):
    path = os.path.join(out, "material.glb")
    command = ["node", "-e", VALIDATE, os.environ["NODE_TOOLS"], path]
    report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["issues"]
    assert report["numErrors"] == report["numWarnings"] == 0, report["messages"]
    told, views = parse(path)
    primitive = told["meshes"][0]["primitives"][0]
    view = lambda accessor: views[told["accessors"][accessor]["bufferView"]]
    floats = lambda name, n: np.frombuffer(view(primitive["attributes"][name]), "<f4").reshape(-1, n)
    corners = np.frombuffer(view(primitive["indices"]), "<u4").reshape(-1, 3)
    ball.check_shape(floats("POSITION", 3), floats("NORMAL", 3), corners, floats("TEXCOORD_0", 2)[:, 1])
    material = told["materials"][0]
    pbr, specular = material["pbrMetallicRoughness"], material["extensions"]["KHR_materials_specular"]
    assert pbr["metallicFactor"] == 0

    def picture(info):
        source = told["images"][told["textures"][info["index"]]["source"]]
        return np.asarray(Image.open(io.BytesIO(views[source["bufferView"]]))) / 255.0

    base = ball.from_srgb(picture(pbr["baseColorTexture"])) * pbr["baseColorFactor"][:3]
    rough = picture(pbr["metallicRoughnessTexture"])[..., 1:2] * pbr["roughnessFactor"]
    colour = ball.from_srgb(picture(specular["specularColorTexture"])[..., :3]) * specular["specularColorFactor"]
    strength = picture(specular["specularTexture"])[..., 3:] * specular["specularFactor"]
    base, rough, colour, strength = (ball.sample(texture, points.uv) for texture in (base, rough, colour, strength))
    # KHR_materials_specular: fresnel_mix; glTF 2.0, appendix B: specular_brdf.
    f0 = np.minimum(0.04 * colour, 1)
    fresnel = f0 + (1 - f0) * ((1 - np.abs(points.difference)) ** 5)[:, None]
    alpha = rough[:, 0] ** 2
    lobe = (ball.smith_separable(alpha, points) * ball.trowbridge_reitz(alpha, points))[:, None]
    return (1 - strength * fresnel.max(axis=1, keepdims=True)) * base / np.pi + strength * fresnel * lobe


if __name__ == "__main__":
    ball.main(sys.argv[1], "gltf", read)
