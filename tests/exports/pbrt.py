#!/usr/bin/env python3
"""`rigd export --format pbrt` read by a strict parser of pbrt-v4's language, and evaluated as pbrt-v4 defines its materials.

The parser takes the directives, types and parameters that pbrt-v4 documents for what is used, and refuses everything else: a
misspelt parameter, which pbrt would refuse as well, does not pass. A mix is evaluated as the mean over its random choices.
"""
import os, re, sys, tempfile
import numpy as np
from common import SCENES, agrees, ball, bilinear, brdf, export, loss, oracle, planes, tile, write_result

TOKEN = re.compile(r'\s*(?:#[^\n]*\n\s*)*("[^"]*"|\[|\]|[^\s"\[\]#]+)')
# Directive: how many numbers or strings come before its parameters.
DIRECTIVES = {"Scale": 3, "LookAt": 9, "Camera": 1, "Sampler": 1, "PixelFilter": 1, "Integrator": 1, "Film": 1, "WorldBegin": 0,
              "LightSource": 1, "Texture": 3, "MakeNamedMaterial": 1, "NamedMaterial": 1, "Shape": 1}
BEFORE_WORLD = ("Scale", "LookAt", "Camera", "Sampler", "PixelFilter", "Integrator", "Film")
# Type and parameters of each thing: name -> (type, how many values).
KNOWN = {
    ("Camera", "perspective"): {"fov": ("float", 1)},
    ("Sampler", "zsobol"): {"pixelsamples": ("integer", 1)},
    ("PixelFilter", "box"): {},
    ("Integrator", "path"): {"maxdepth": ("integer", 1)},
    ("Film", "rgb"): {"xresolution": ("integer", 1), "yresolution": ("integer", 1), "filename": ("string", 1)},
    ("LightSource", "distant"): {"from": ("point3", 3), "to": ("point3", 3), "L": ("rgb", 3)},
    ("Texture", "imagemap"): {"filename": ("string", 1), "wrap": ("string", 1), "filter": ("string", 1)},
    ("Material", "diffuse"): {"reflectance": ("rgb", 3)},
    ("Material", "conductor"): {"reflectance": ("rgb", 3), "roughness": ("float", 1), "remaproughness": ("bool", 1)},
    ("Material", "mix"): {"materials": ("string", 2), "amount": (("float", "texture"), 1)},
    ("Shape", "plymesh"): {"filename": ("string", 1)},
}


def tokens(text):
    at = 0
    while text[at:].strip():
        match = TOKEN.match(text, at)
        assert match, text[at:at + 40]
        yield match.group(1)
        at = match.end()


def value(kind, token):
    if kind in ("string", "texture"):
        assert token[0] == '"', token
        return token[1:-1]
    if kind == "bool":
        return {"true": True, "false": False}[token]
    return int(token) if kind == "integer" else float(token)


def parse(text):
    """Directives with what precedes their parameters, and the parameters as (type, values)."""
    words, at, out = list(tokens(text)), 0, []
    while at < len(words):
        name = words[at]
        before = words[at + 1:at + 1 + DIRECTIVES[name]]
        assert len(before) == DIRECTIVES[name], name
        at += 1 + len(before)
        parameters = {}
        while at < len(words) and words[at][0] == '"':
            kind, key = words[at][1:-1].split(" ")
            assert key not in parameters, f"{key} twice"
            at += 1
            if words[at] == "[":
                end = words.index("]", at)
                given, at = words[at + 1:end], end + 1
            else:
                given, at = [words[at]], at + 1
            parameters[key] = (kind, [value(kind, token) for token in given])
        out.append((name, before, parameters))
    return out


def checked(kind, name, parameters):
    known = KNOWN[kind, name]
    for key, (given, values) in parameters.items():
        types, count = known[key]
        assert given in (types if isinstance(types, tuple) else (types,)) and len(values) == count, (name, key)
        assert given != "rgb" or kind == "LightSource" or max(values) <= 1, f"{name} {key}: pbrt cuts off what exceeds 1"
    return {key: values if len(values) > 1 else values[0] for key, (_, values) in parameters.items()}, parameters


class Scene:
    def __init__(self, folder):
        self.textures, self.materials, self.shape, world, current = {}, {}, None, False, None
        plain = lambda token: token[1:-1]
        for name, before, parameters in parse(open(os.path.join(folder, "scene.pbrt")).read()):
            assert (name in BEFORE_WORLD) != world or name == "WorldBegin", f"{name} on the wrong side of WorldBegin"
            if name == "WorldBegin":
                world = True
            elif name in ("Scale", "LookAt"):
                setattr(self, name, [float(token) for token in before])
            elif name == "Texture":
                key, kind, plugin = map(plain, before)
                said, _ = checked("Texture", plugin, parameters)
                assert kind == "float" and said["wrap"] == "repeat" and said["filter"] == "bilinear"
                channels = planes(os.path.join(folder, said["filename"]))
                assert list(channels) == ["Y"], "a float texture has one channel"
                self.textures[key] = channels["Y"].astype(float)
            elif name == "MakeNamedMaterial":
                kind = parameters.pop("type")[1][0]
                self.materials[plain(before[0])] = (kind, *checked("Material", kind, parameters))
            elif name == "NamedMaterial":
                current = plain(before[0])
                assert current in self.materials
            else:
                said, _ = checked(name, plain(before[0]), parameters)
                if name == "LightSource":
                    self.light = said
                if name == "Shape":
                    self.shape, self.material = os.path.join(folder, said["filename"]), current

    def evaluate(self, name, uv, n, l, v):
        """BRDF per channel of a material at texture coordinates that run up, as pbrt's do."""
        kind, said, parameters = self.materials[name]
        if kind == "diffuse":
            return np.array(said["reflectance"]) / np.pi
        if kind == "conductor":
            assert said["remaproughness"] is False
            return conductor(np.array(said["reflectance"]), said["roughness"], n, l, v)
        amount = said["amount"]
        if parameters["amount"][0] == "texture":
            amount = bilinear(self.textures[amount], uv[0], 1 - uv[1])
        first, second = (self.evaluate(other, uv, n, l, v) if part else 0 for other, part in zip(said["materials"], (amount < 1, amount > 0)))
        return (1 - amount) * first + amount * second


def conductor(reflectance, alpha, n, l, v):
    """Trowbridge and Reitz, masking correlated by height, Fresnel of index 1 - i k (pbrt-v4's book, sections 9.5 and 9.6)."""
    h = oracle.half(l, v)
    slope = oracle.tan2(n, h) / alpha**2
    distribution = 1 / (np.pi * alpha**2 * (n @ h) ** 4 * (1 + slope) ** 2)
    shadow = lambda w: (np.sqrt(1 + alpha**2 * oracle.tan2(n, w)) - 1) / 2
    eta = 1 + 2j * np.sqrt(reflectance) / np.sqrt(1 - np.minimum(reflectance, 0.9999))
    cos = l @ h
    within = np.sqrt(1 - (1 - cos**2) / eta**2)
    parallel, across = (eta * cos - within) / (eta * cos + within), (cos - eta * within) / (cos + eta * within)
    fresnel = (np.abs(parallel) ** 2 + np.abs(across) ** 2) / 2
    return distribution * fresnel / (1 + shadow(l) + shadow(v)) / (4 * (n @ l) * (n @ v))


def check(rigd, name):
    model, materials = SCENES[name]
    with tempfile.TemporaryDirectory() as folder:
        result, out = os.path.join(folder, "result"), os.path.join(folder, "out")
        write_result(result, model, materials)
        told = export(rigd, result, "pbrt", out)
        texels = tile(rigd, result, os.path.join(folder, "exr"))
        scene = Scene(out)
        assert scene.Scale == [-1, 1, 1], "pbrt's camera is left-handed"
        towards = np.array(scene.light["from"]) - scene.light["to"]
        assert np.allclose(oracle.unit(towards), oracle.unit(np.array([-0.3, 0.4, 1])), atol=1e-6)
        brighter = scene.light["L"][0] / 6
        ours = lambda n, l, v, uv: brdf(model, materials, bilinear(texels, *uv), n, l, v)
        theirs = lambda n, l, v, uv: brighter * scene.evaluate(scene.material, (uv[0], 1 - uv[1]), n, l, v)
        found = loss(ball(scene.shape, v_up=True, count=1500), ours, theirs)
        agrees(f"pbrt, {len(materials)} materials of {model}, light {brighter:.3f} times as bright", found, told, exact=False)


if __name__ == "__main__":
    for name in ("lambert", "ggx", "ward"):
        check(sys.argv[1], name)
