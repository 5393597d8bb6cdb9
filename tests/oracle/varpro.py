#!/usr/bin/env python3
"""Independent check of variable projection: the optima in varpro.json, made without any of rigd's code.

    venv/bin/python tests/oracle/varpro.py            writes varpro.json beside this file (zheng2008.py says how to make venv)
    venv/bin/python tests/oracle/varpro.py --check    makes the scenes again, solves those of the file again, compares

The product eliminates the weights point by point, in f32, and searches over the BRDF parameters. Here all BRDF parameters
and all weights are unknowns of one dense problem in f64, solved by scipy's trust-region solver from the truth and from
another start and polished by Gauss-Newton steps until the gradient is rounding. Objective: the sum of
(I - model)^2 / (variance + (0.02 I)^2).
Gauge: the largest diffuse albedo of each material stays that of the truth; what is written does not depend on it.

With weights >= 0 the search runs over the BRDF parameters with Lawson-Hanson NNLS at every point; then the weights that came
out positive are polished with the parameters as above, and the conditions of an optimum are verified: weights positive where
free, and where held at zero the cost does not fall with them.
"""
import json, math, os, sys
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy starts them: the matrices are small
import numpy as np
from scipy.optimize import least_squares, nnls

HERE = os.path.dirname(os.path.abspath(__file__))
FILE = os.path.join(HERE, "varpro.json")
MODEL_FLOOR = 0.02
LIGHTS = 7
PER = 7  # parameters of a material: rho_d, rho_s, ln beta
SCENES = [
    {"model": "ward", "seed": 11, "points": 70,
     "truth": [([0.60, 0.45, 0.30], [0.05, 0.06, 0.04], 0.12), ([0.12, 0.22, 0.38], [0.07, 0.05, 0.06], 0.25)]},
    {"model": "ggx", "seed": 12, "points": 90,
     "truth": [([0.25, 0.50, 0.35], [0.06, 0.06, 0.08], 0.30), ([0.55, 0.20, 0.15], [0.04, 0.05, 0.04], 0.15)]},
]


def ward(cos_i, cos_r, tan2, cos_iv, beta):
    return np.exp(-tan2 / beta**2) / (4 * np.pi * beta**2) / np.sqrt(cos_i * cos_r)


def ggx(cos_i, cos_r, tan2, cos_iv, beta):
    """Walter et al. 2007 with Smith's masking and Schlick's Fresnel relative to normal incidence."""
    distribution = beta**2 * (1 + tan2) ** 2 / (np.pi * (beta**2 + tan2) ** 2)
    masking = 1.0
    for cos in (cos_i, cos_r):
        masking = masking * 2 / (1 + np.sqrt(1 + beta**2 * (1 - cos**2) / cos**2))
    fresnel = (0.04 + 0.96 * (1 - np.sqrt((1 + cos_iv) / 2)) ** 5) / 0.04
    return distribution * masking * fresnel / (4 * cos_i * cos_r)


MODELS = {"ward": ward, "ggx": ggx}


def short(values):
    """The fewest digits that name the f32 next to a value: what the product keeps of it."""
    return [float(str(np.float32(v))) for v in values]


def sample(rng, scene, normal, light, gamma, noise):
    """One sample as the file has it: light, angles, irradiance, radiance, variance; none where the light does not reach.
    The variance knows of `noise`, not of the 2 % that the model floor stands for."""
    station, view = math.radians(-60 + 20 * light), np.array([0.0, 0.0, -1.0])
    to = np.array([math.sin(station), 0.1, -math.cos(station)])
    to /= np.linalg.norm(to)
    half = (to + view) / np.linalg.norm(to + view)
    cos_i, cos_r, cos_h = normal @ to, normal @ view, normal @ half
    if min(cos_i, cos_r) < 0.1:
        return None
    seen = (cos_i, cos_r, (1 - cos_h**2) / cos_h**2, to @ view)
    irradiance = np.array([3.0, 2.8, 2.5]) * cos_i
    lobe = MODELS[scene["model"]]
    brdf = sum(g * (np.array(d) / np.pi + np.array(s) * lobe(*seen, b)) for g, (d, s, b) in zip(gamma, scene["truth"]))
    exact = irradiance * brdf
    radiance = exact * (1 + math.hypot(MODEL_FLOOR, noise) * rng.standard_normal(3))
    return [light, short(seen), short(irradiance), short(radiance), short((noise * exact) ** 2)]


def make(scene):
    """Points of a ball; three in ten of the weights are zero. Every third point is noisy: it pulls the parameters little, so
    that weights >= 0 hold there."""
    rng, points = np.random.default_rng(scene["seed"]), []
    while len(points) < scene["points"]:
        x, y = rng.uniform(-0.9, 0.9, 2)
        if x * x + y * y > 0.85:
            continue
        noise = 0.15 if len(points) % 3 == 0 else 0.005
        first = min(max(rng.uniform(-0.75, 1.75), 0.0), 1.0)
        normal = np.array([x, y, -math.sqrt(1 - x * x - y * y)])
        samples = [sample(rng, scene, normal, light, (first, 1 - first), noise) for light in range(LIGHTS)]
        samples = [s for s in samples if s is not None]
        if len(samples) >= 4:
            points.append(samples)
    return points


class Joint:
    """All samples as arrays, and residuals and derivatives of the joint problem."""

    def __init__(self, scene, points):
        as_kept = lambda column: np.float32([s[column] for p in points for s in p]).astype(float)
        self.lobe, self.truth = MODELS[scene["model"]], scene["truth"]
        self.point = np.array([i for i, p in enumerate(points) for _ in p])
        self.points = len(points)
        self.angles, self.e, self.i = as_kept(1).T, as_kept(2), as_kept(3)
        self.w = 1 / np.sqrt(as_kept(4) + (MODEL_FLOOR * self.i) ** 2)
        self.gauge = [PER * m + int(np.argmax(d)) for m, (d, _, _) in enumerate(self.truth)]
        self.free = [k for k in range(PER * len(self.truth)) if k not in self.gauge]

    def alpha(self, x):
        full = np.concatenate([[*d, *s, math.log(b)] for d, s, b in self.truth])
        full[self.free] = x
        return full.reshape(-1, PER)

    def start(self, change=lambda k: 0.0):
        """The truth, or parameters off by the factor e^change."""
        full = np.concatenate([[*d, *s, math.log(b)] for d, s, b in self.truth])
        return np.array([full[k] + change(k) if k % PER == 6 else full[k] * math.exp(change(k)) for k in self.free])

    def units(self, alpha):
        """Per material, radiance at unit weight in residual units: samples x channels; and the derivatives of it."""
        units, slopes, h = [], [], 1e-30
        for a in alpha:
            lobe = self.lobe(*self.angles, np.exp(a[6] + 1j * h))  # complex step: exact to rounding
            value, slope = lobe.real[:, None], lobe.imag[:, None] / h
            scale = self.w * self.e
            units.append(scale * (a[:3] / np.pi + a[3:6] * value))
            by = np.zeros((PER, *scale.shape))
            for c in range(3):
                by[c, :, c], by[3 + c, :, c] = scale[:, c] / np.pi, (scale * value)[:, c]
            by[6] = scale * a[3:6] * slope
            slopes.append(by)
        return np.array(units), np.array(slopes)

    def residuals(self, alpha, gamma):
        units, _ = self.units(alpha)
        return (self.w * self.i - np.einsum("sm,msc->sc", gamma[self.point], units)).ravel()

    def jacobian(self, alpha, gamma, mask):
        """By the free parameters, then by the weights in `mask` (points x materials)."""
        units, slopes = self.units(alpha)
        by_alpha = -np.einsum("sm,mksc->scmk", gamma[self.point], slopes).reshape(self.w.size, -1)[:, self.free]
        by_gamma = np.zeros((*self.w.shape, *mask.shape))
        by_gamma[np.arange(len(self.point)), :, self.point] = -units.transpose(1, 2, 0)
        return np.hstack([by_alpha, by_gamma.reshape(self.w.size, -1)[:, mask.ravel()]])

    def weights(self, alpha, solve):
        units, _ = self.units(alpha)
        gamma = np.zeros((self.points, len(alpha)))
        for p in range(self.points):
            mine = self.point == p
            gamma[p] = solve(units[:, mine].reshape(len(alpha), -1).T, (self.w * self.i)[mine].ravel())
        return gamma

    def solve_joint(self, alpha, gamma, mask, evaluations):
        """Everything at once with the weights outside `mask` at zero, from here."""
        n = len(self.free)

        def unpack(x):
            gamma = np.zeros(mask.shape)
            gamma[mask] = x[n:]
            return self.alpha(x[:n]), gamma

        x = np.concatenate([alpha.ravel()[self.free], gamma[mask]])
        if evaluations:
            x = least_squares(lambda x: self.residuals(*unpack(x)), x, lambda x: self.jacobian(*unpack(x), mask),
                              method="trf", x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-15, max_nfev=evaluations).x
        for _ in range(12):
            j, r = self.jacobian(*unpack(x), mask), self.residuals(*unpack(x))
            x = x - np.linalg.lstsq(j / np.linalg.norm(j, axis=0), r, rcond=None)[0] / np.linalg.norm(j, axis=0)
        j, r = self.jacobian(*unpack(x), mask), self.residuals(*unpack(x))
        gradient = np.abs(j.T @ r / np.linalg.norm(j, axis=0)).max() / np.linalg.norm(r)
        assert gradient < 1e-11, f"not stationary: cosine {gradient:.1e} of residuals with a derivative"
        variance = r @ r / (len(r) - len(x))
        _, upper = np.linalg.qr(j)
        sigma = np.sqrt(variance * np.sum(np.linalg.inv(upper) ** 2, axis=1))
        return (*unpack(x), float(r @ r), sigma, gradient)

    def free_optimum(self, start):
        """Weights of either sign."""
        alpha = self.alpha(start)
        gamma = self.weights(alpha, lambda a, b: np.linalg.lstsq(a, b, rcond=None)[0])
        mask = np.ones(gamma.shape, bool)
        return (*self.solve_joint(alpha, gamma, mask, 300), mask)

    def non_negative_optimum(self, start):
        solve = lambda a, b: nnls(a, b)[0]

        def residuals(x):
            return self.residuals(self.alpha(x), self.weights(self.alpha(x), solve))

        def jacobian(x):
            """The derivative by the parameters without what the positive weights can follow: its product with the
            residuals is the gradient of the projected cost."""
            alpha = self.alpha(x)
            gamma = self.weights(alpha, solve)
            j = self.jacobian(alpha, gamma, gamma > 0)
            q, _ = np.linalg.qr(j[:, len(x):])
            return j[:, : len(x)] - q @ (q.T @ j[:, : len(x)])

        x = least_squares(residuals, start, jacobian, method="trf", x_scale="jac",
                          ftol=1e-15, xtol=1e-13, gtol=1e-13, max_nfev=300).x
        gamma = self.weights(self.alpha(x), solve)
        mask = gamma > 0
        found = self.solve_joint(self.alpha(x), gamma, mask, 0)
        alpha, gamma = found[:2]
        assert (gamma[mask] > 0).all(), "a free weight is negative"
        pull = np.einsum("sc,msc->sm", self.residuals(alpha, gamma).reshape(self.w.shape), self.units(alpha)[0])
        held = np.stack([np.bincount(self.point, column, self.points) for column in pull.T], axis=1)[~mask]
        assert (held < 0).all(), "a weight held at zero wants to grow"
        return (*found, mask)


def optimum(joint, how):
    """The optimum of one problem, from two starts, without the gauge."""
    solve = joint.free_optimum if how == "free" else joint.non_negative_optimum
    other = joint.start(lambda k: [0.25, -0.2, 0.15, 0.4, -0.3, 0.3, -0.35][k % PER] * (1 if k < PER else -1))
    found, again = solve(joint.start()), solve(other)
    assert abs(again[2] / found[2] - 1) < 1e-12, f"two optima: {found[2]} and {again[2]}"
    alpha, gamma, cost, sigma, gradient, mask = found
    inside = (alpha[:, :6] > 0).all() and (alpha[:, 3:6] < 1).all() and (alpha[:, 6] > math.log(0.02)).all()
    assert inside and (alpha[:, 6] < math.log(0.45)).all(), "the product bounds the parameters"
    full, weight_sigma = np.zeros(alpha.size), np.zeros(mask.shape)
    full[joint.free], weight_sigma[mask] = sigma[: len(joint.free)], sigma[len(joint.free):]
    largest = alpha.ravel()[joint.gauge]
    unit = np.stack([np.append(np.full(6, g), 1.0) for g in largest])
    print(f"  {how}: cost {cost:.9f}, {mask.size - mask.sum()} weights at zero, gradient {gradient:.0e}")
    return {"cost": cost, "unknowns": int(len(joint.free) + mask.sum()),
            # Per material: rho_d and rho_s over the largest rho_d, ln beta; standard errors; 0 for what fixes the gauge.
            "alpha": (alpha / unit).tolist(), "alpha_error": (full.reshape(-1, PER) / unit).tolist(),
            # Per point and material: weight times the largest rho_d; 0 for the error of a weight held at zero.
            "products": (gamma * largest).tolist(), "products_error": (weight_sigma * largest).tolist()}


def solved(scene, points):
    joint = Joint(scene, points)
    print(f"{scene['model']}: {joint.points} points, {len(joint.point)} samples")
    return {how: optimum(joint, how) for how in ("free", "non_negative")}


def worst(a, b):
    """Largest difference of two trees of numbers, relative, of small numbers absolute."""
    if isinstance(a, dict):
        return max(worst(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return max((worst(x, y) for x, y in zip(a, b, strict=True)), default=0.0)
    return abs(a - b) / max(abs(a), abs(b), 1e-2)


if __name__ == "__main__":
    if "--check" in sys.argv:
        stored = json.load(open(FILE))
        # One unit in the last place of f32 is left to the libraries that round sines and roots.
        inputs = max(worst(make(scene), old["points"]) for scene, old in zip(SCENES, stored, strict=True))
        optima = max(worst(solved(scene, old["points"]), old["optima"]) for scene, old in zip(SCENES, stored))
        print(f"largest relative difference of the scenes {inputs:.2e}, of the optima {optima:.2e}")
        sys.exit(not (inputs < 2.5e-7 and optima < 1e-8))
    made = [{"model": scene["model"], "points": make(scene)} for scene in SCENES]
    for scene, out in zip(SCENES, made):
        out["optima"] = solved(scene, out["points"])
    json.dump(made, open(FILE, "w"), separators=(",", ":"))
    print("wrote", FILE, os.path.getsize(FILE), "bytes")
