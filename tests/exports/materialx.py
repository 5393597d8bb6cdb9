#!/usr/bin/env python3
"""MaterialX: its own package finds the document valid, makes shader code of it, and the graph, walked node by node, reflects as loss.json says."""
import os, sys
import numpy as np
import MaterialX as mx
import MaterialX.PyMaterialXGenShader as gen
import MaterialX.PyMaterialXGenGlsl as glsl
from PIL import Image
import ball

SAMPLES = 20_000


def g2(alpha, light, view):
    """Smith, correlated by height (Heitz 2014)."""
    lam = lambda c: (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) / 2
    return 1 / (1 + lam(light) + lam(view))


def albedos(alpha, f0):
    """Of a lobe by the cosine of the view: reflectance 1, and Schlick's. Facets at random, as they are distributed."""
    rng = np.random.default_rng(7)
    u, phi = rng.random(SAMPLES), 2 * np.pi * rng.random(SAMPLES)
    n = 1 / np.sqrt(1 + alpha**2 * u / (1 - u))
    cosines = np.linspace(0.01, 1, 60)
    table = []
    for v in cosines:
        along = v * n + np.sqrt(1 - v * v) * np.sqrt(1 - n * n) * np.cos(phi)
        light = 2 * along * n - v
        ok = (along > 0) & (light > 0)
        seen = np.where(ok, g2(alpha, np.where(ok, light, 1), v) * along / (v * n), 0)
        table.append([seen.mean(), (seen * (f0 + (1 - f0) * np.clip(1 - along, 0, 1) ** 5)).mean()])
    table = np.array(table)
    return lambda c: (np.interp(c, cosines, table[:, 0]), np.interp(c, cosines, table[:, 1]))


def dielectric(c, ior):
    g = np.sqrt(ior**2 + c**2 - 1)
    return 0.5 * ((g - c) / (g + c)) ** 2 * (1 + (((g + c) * c - 1) / ((g - c) * c + 1)) ** 2)


class Graph:
    def __init__(self, document, out, angles):
        self.document, self.out, self.a = document, out, angles

    def input(self, node, name):
        port = node.getInput(name)
        if port is None:
            port = node.getNodeDef().getActiveInput(name)
        if port.getNodeName():
            return self.value(self.document.getNode(port.getNodeName()))
        value = port.getValue()
        return np.array([value[i] for i in range(3)]) if isinstance(value, mx.Color3) else value

    def value(self, node):
        get = lambda name: self.input(node, name)
        kind = node.getCategory()
        if kind == "image":
            picture = np.asarray(Image.open(os.path.join(self.out, node.getInput("file").getValue())))
            assert picture.dtype == np.uint16 or picture.dtype == np.int32, picture.dtype
            return ball.sample(picture[..., None] / 65535.0, self.a.uv)
        if kind in ("multiply", "subtract", "divide"):
            a, b = get("in1"), get("in2")
            return a * b if kind == "multiply" else a - b if kind == "subtract" else a / b
        if kind == "mix":
            share = get("mix")
            return (1 - share) * get("bg") + share * get("fg")
        assert kind == "standard_surface", kind
        return self.surface(get)

    def surface(self, get):
        a = self.a
        for off in ("metalness", "transmission", "subsurface", "sheen", "coat", "emission", "diffuse_roughness", "specular_anisotropy"):
            assert get(off) == 0, off
        alpha, ior, weight = get("specular_roughness") ** 2, get("specular_IOR"), get("specular")[:, 0]
        fresnel = dielectric(a.difference, ior)
        whole, own = albedos(alpha, ((ior - 1) / (ior + 1)) ** 2)(a.view)
        gain = 1 + fresnel * (1 - whole) / whole
        lobe = ball.trowbridge_reitz(alpha, a) * fresnel * g2(alpha, a.light, a.view) / (4 * a.light * a.view) * gain * weight
        left = 1 - own * gain * weight
        return left[:, None] * get("base") * get("base_color") / np.pi + get("specular_color") * lobe[:, None]


def read(out, points):
    document = mx.createDocument()
    mx.readFromXmlFile(document, os.path.join(out, "material.mtlx"))
    libraries = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), libraries)
    document.setDataLibrary(libraries)
    valid, words = document.validate()
    assert valid, words
    # Shader code can be made of it.
    generator = glsl.GlslShaderGenerator.create()
    context = gen.GenContext(generator)
    context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    colours = gen.DefaultColorManagementSystem.create(generator.getTarget())
    colours.loadLibrary(libraries)
    generator.setColorManagementSystem(colours)
    material = document.getNode("captured")
    assert "mx_dielectric_bsdf" in generator.generate("captured", material, context).getSourceCode("pixel")
    top = document.getNode(material.getInput("surfaceshader").getNodeName())
    return Graph(document, out, points).value(top)


if __name__ == "__main__":
    ball.main(sys.argv[1], "materialx", read)
