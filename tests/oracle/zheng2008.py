#!/usr/bin/env python3
"""Independent check of the paper's equations: the numbers in zheng2008.json, made without any of rigd's code.

Needs numpy and scipy:  python3 -m venv venv && venv/bin/pip install numpy==2.4.6 scipy==1.17.1
    venv/bin/python tests/oracle/zheng2008.py            writes zheng2008.json beside this file
    venv/bin/python tests/oracle/zheng2008.py --check    computes everything again and compares with the file

Eq. 8 is solved here as one sparse least-squares system (the product uses a closed form), Eq. 9 and the BRDF half-step by
scipy's trust-region solver with numeric residuals only (the product: Levenberg-Marquardt with analytic derivatives), the
weights of Eq. 10 by Lawson-Hanson NNLS with a slack row for the sum (the product enumerates the active constraints).
"""
import json, math, os, sys
import numpy as np
from scipy.optimize import least_squares, nnls
from scipy.sparse import lil_matrix
from scipy.sparse.linalg import lsqr

HERE = os.path.dirname(os.path.abspath(__file__))
FILE = os.path.join(HERE, "zheng2008.json")
TRUTH = [([0.55, 0.40, 0.30], [0.06, 0.05, 0.05], 0.14), ([0.12, 0.22, 0.38], [0.04, 0.05, 0.06], 0.24)]


def angles(n, l, v):
    """cos theta_i, cos theta_r, tan^2 of the half angle."""
    h = l + v
    h /= np.linalg.norm(h)
    cos_h = n @ h
    return n @ l, n @ v, (1.0 - cos_h**2) / cos_h**2


def ward(cos_i, cos_r, tan2, rho_d, rho_s, beta):
    """Eq. 4; returns the BRDF per channel."""
    lobe = math.exp(-tan2 / beta**2) / (4 * math.pi * beta**2) / math.sqrt(cos_i * cos_r)
    return np.array(rho_d) / math.pi + np.array(rho_s) * lobe


def rounded(values):
    return np.float32(values).astype(float)


def problem(rng):
    """Points of a ball, seven near lights, 1 % noise; a sample is (cos_i, cos_r, tan2, l_c cos_i, radiance), rounded to f32 as
    the product keeps its observations."""
    lights = [np.array([600 * math.sin(a), 0.0, 1500 - 600 * math.cos(a)]) for a in np.radians([-55, -20, 15, 50, 85, 115, 140])]
    centre, radius, points = np.array([0.0, 0.0, 1500.0]), 30.0, []
    while len(points) < 60:
        x, y = rng.uniform(-0.9, 0.9, 2)
        if x * x + y * y > 0.8:
            continue
        n = np.array([x, y, -math.sqrt(1 - x * x - y * y)])
        p = centre + radius * n
        v = -p / np.linalg.norm(p)
        g = rng.uniform(0.1, 1.0)
        gamma = rng.permutation([g, rng.choice([0.0, (1 - g) * 0.8])])
        samples = []
        for light in lights:
            d = light - p
            l = d / np.linalg.norm(d)
            if n @ l <= 0.1 or n @ v <= 0.1:
                continue
            irradiance = np.array([4.0e5, 3.6e5, 3.0e5]) / (d @ d)
            seen = angles(n, l, v)
            f = sum(gm * ward(*seen, *m) for gm, m in zip(gamma, TRUTH))
            radiance = irradiance * (n @ l) * f * (1 + 0.01 * rng.standard_normal(3))
            samples.append((*(float(np.float32(a)) for a in seen), rounded(irradiance * (n @ l)), rounded(radiance)))
        if len(samples) >= 3:
            points.append(samples)
    return points


def ratio(s):
    """I / R of Eq. 5-6 per channel."""
    _, _, _, irradiance, radiance = s
    return radiance / (irradiance / math.pi)


def eq8(points):
    """ln gamma and ln rho_d as one sparse least-squares problem, gauge: largest gamma is 1."""
    rows = sum(3 * len(p) for p in points)
    a, b, r = lil_matrix((rows + 1, len(points) + 3)), np.zeros(rows + 1), 0
    for i, samples in enumerate(points):
        for s in samples:
            for c, y in enumerate(np.log(ratio(s))):
                a[r, i], a[r, len(points) + c], b[r] = 1, 1, y
                r += 1
    a[r, 0] = 1  # any gauge makes it unique; the paper's is applied afterwards
    x = lsqr(a.tocsr(), b, atol=1e-15, btol=1e-15, iter_lim=100000)[0]
    top = x[: len(points)].max()
    return np.exp(x[: len(points)] - top), np.exp(x[len(points) :] + top)


def model(samples, gamma, alpha):
    return np.array([sum(g * irradiance * ward(*seen, *m) for g, m in zip(gamma, alpha))
                     for *seen, irradiance, _ in samples])


def measured(samples):
    return np.array([s[4] for s in samples])


def fit(residuals, start, lower, upper):
    best = least_squares(residuals, start, bounds=(lower, upper), method="trf", x_scale="jac", jac="3-point",
                         ftol=1e-15, xtol=1e-15, gtol=1e-15, max_nfev=4000)
    return best.x


def eq9(points, gamma, rho_d):
    def residuals(x):
        m = [(rho_d, x[:3], math.exp(x[3]))]
        return np.concatenate([(model(p, [g], m) - measured(p)).ravel() for p, g in zip(points, gamma)])
    x = fit(residuals, [0.1, 0.1, 0.1, math.log(0.2)], [0, 0, 0, math.log(0.01)], [1, 1, 1, math.log(0.5)])
    return x[:3], math.exp(x[3])


def scale(samples, objective):
    return np.ones_like(measured(samples)) if objective == "absolute" else 1 / measured(samples)


def weights(samples, alpha, objective, rule):
    w = scale(samples, objective).ravel()
    a = np.stack([model(samples, [1.0], [m]).ravel() * w for m in alpha], axis=1)
    b = measured(samples).ravel() * w
    if rule == "exact":
        return nnls(a, b)[0]
    heavy = 1e6 * np.abs(a).max()  # gamma + slack = 1 as a row that nothing else can outweigh
    a = np.vstack([np.hstack([a, np.zeros((len(b), 1))]), heavy * np.ones((1, len(alpha) + 1))])
    return nnls(a, np.append(b, heavy))[0][: len(alpha)]


def normal_form(gammas, alpha):
    """Largest gamma of each material 1, as the product fixes the gauge after the exact weights."""
    top = np.max(gammas, axis=0)
    return gammas / top, [(np.array(d) * t, np.array(s) * t, b) for (d, s, b), t in zip(alpha, top)]


def alternation(points, alpha, objective, rule):
    gammas = np.array([weights(p, alpha, objective, rule) for p in points])
    if rule == "exact":
        gammas, alpha = normal_form(gammas, alpha)
    def unpack(x):
        return [(x[7 * m : 7 * m + 3], x[7 * m + 3 : 7 * m + 6], math.exp(x[7 * m + 6])) for m in range(2)]
    def residuals(x):
        return np.concatenate([((model(p, g, unpack(x)) - measured(p)) * scale(p, objective)).ravel()
                               for p, g in zip(points, gammas)])
    start = np.concatenate([[*d, *s, math.log(b)] for d, s, b in alpha])
    low = np.tile([0] * 6 + [math.log(0.01)], 2)
    high = np.tile([np.inf] * 3 + [1] * 3 + [math.log(0.5)], 2)
    x = fit(residuals, start, low, high)
    cost = float(np.sum(residuals(x) ** 2))
    return {"objective": objective, "rule": rule, "gamma": gammas.tolist(), "cost": cost,
            "materials": [{"rho_d": list(d), "rho_s": list(s), "beta": b} for d, s, b in unpack(x)]}


def compute():
    rng = np.random.default_rng(2008)
    points = problem(rng)
    eq4 = []
    for _ in range(20):
        n, l, v = (np.array([*rng.uniform(-0.5, 0.5, 2), -1.0]) for _ in range(3))
        n, l, v = (a / np.linalg.norm(a) for a in (n, l, v))
        rho_d, rho_s, beta = rng.uniform(0, 1, 3), rng.uniform(0, 0.3, 3), math.exp(rng.uniform(math.log(0.05), 0))
        eq4.append({"normal": n.tolist(), "light": l.tolist(), "view": v.tolist(), "rho_d": rho_d.tolist(),
                    "rho_s": rho_s.tolist(), "beta": beta, "brdf": ward(*angles(n, l, v), rho_d, rho_s, beta).tolist()})
    dark = [sorted(p, key=lambda s: s[4].sum())[: max(len(p) - 2, 1)] for p in points]
    gamma, rho_d = eq8(dark)
    rho_s, beta = eq9(points, gamma, rho_d)
    start = [([0.5, 0.42, 0.33], [0.05, 0.05, 0.05], 0.17), ([0.14, 0.2, 0.33], [0.05, 0.05, 0.05], 0.2)]
    rounds = [alternation(points, start, o, r) for o in ("absolute", "relative") for r in ("paper", "exact")]
    return {
        "points": [[{"cos_i": ci, "cos_r": cr, "tan2_half": t, "irradiance": e.tolist(), "radiance": i.tolist()}
                    for ci, cr, t, e, i in p] for p in points],
        "eq4": eq4,
        "eq8": {"gamma": gamma.tolist(), "rho_d": rho_d.tolist()},
        "eq9": {"rho_s": rho_s.tolist(), "beta": beta},
        "start": [{"rho_d": d, "rho_s": s, "beta": b} for d, s, b in start],
        "alternations": rounds,
    }


def worst(a, b, path=""):
    """Largest relative difference of two trees of numbers, and where."""
    if isinstance(a, dict):
        return max((worst(a[k], b[k], f"{path}.{k}") for k in a), default=(0.0, path))
    if isinstance(a, list):
        return max((worst(x, y, f"{path}[{i}]") for i, (x, y) in enumerate(zip(a, b, strict=True))), default=(0.0, path))
    if isinstance(a, str):
        return (0.0 if a == b else math.inf, path)
    return (abs(a - b) / max(abs(a), abs(b), 1e-9), path)


if __name__ == "__main__":
    found = compute()
    if "--check" in sys.argv:
        difference, where = worst(found, json.load(open(FILE)))
        print(f"largest relative difference {difference:.2e} at {where}")
        sys.exit(difference > 1e-6)
    json.dump(found, open(FILE, "w"), separators=(",", ":"))
    print("wrote", FILE, os.path.getsize(FILE), "bytes")
