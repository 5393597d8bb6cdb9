#!/usr/bin/env python3
"""OpenCV's calibration of the chessboard photographs: the numbers in camera.json, made without any of rigd's code.

    python3 -m venv venv && venv/bin/pip install -r tests/oracle/camera.txt
    venv/bin/python tests/oracle/camera.py [DATA]            writes camera.json beside this file
    venv/bin/python tests/oracle/camera.py [DATA] --check    computes everything again and compares with the file

DATA is the folder that holds chessboard/ ($RIGD_SHARED/data or ../shared/data if left out): left01.jpg ... right14.jpg, the
photographs of OpenCV's samples, 9 x 6 inner corners; squares are taken as 25 mm.

Corners: findChessboardCorners, then cornerSubPix twice: with OpenCV's usual window of 5 px, and with windows of a fifth of the
distance to the next corner, which is the product's. On both, calibrateCamera under two models. The usual window's corners are
written as well, so that the adjustment is compared on the very same numbers. OpenCV's pixel centres lie at integers; the file
has them at +0.5 (corners and principal points).
"""
import glob, json, os, sys
import cv2
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
FILE = os.path.join(HERE, "camera.json")
COLUMNS, ROWS, SQUARE_MM = 9, 6, 25.0
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
MODELS = {
    "k3": cv2.CALIB_FIX_K3,
    "k3 fy": cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_ASPECT_RATIO,
}


def windows(corners):
    """Half windows: a fifth of the distance to the nearest neighbour in the grid, 3 to 30 px."""
    grid = corners.reshape(ROWS, COLUMNS, 2)
    nearest = np.full((ROWS, COLUMNS), np.inf)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    for part, distance in (((slice(None), slice(1, None)), across), ((slice(None), slice(None, -1)), across),
                           ((slice(1, None), slice(None)), down), ((slice(None, -1), slice(None)), down)):
        nearest[part] = np.minimum(nearest[part], distance)
    return np.clip(np.round(0.2 * nearest), 3, 30).astype(int).ravel()


def find(path):
    """Corners with the usual window and with the product's."""
    grey = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    found, corners = cv2.findChessboardCorners(grey, (COLUMNS, ROWS))
    if not found:
        sys.exit(f"{path}: no board found")
    usual = cv2.cornerSubPix(grey, corners.copy(), (5, 5), (-1, -1), STOP)
    wide = usual.copy()
    for i, half in enumerate(windows(usual.reshape(-1, 2))):
        wide[i : i + 1] = cv2.cornerSubPix(grey, usual[i : i + 1].copy(), (int(half), int(half)), (-1, -1), STOP)
    return grey.shape[::-1], usual, wide


def calibrate(size, views):
    board = np.zeros((ROWS * COLUMNS, 3), np.float32)
    board[:, :2] = np.mgrid[0:COLUMNS, 0:ROWS].T.reshape(-1, 2) * SQUARE_MM
    models = {}
    for held, flags in MODELS.items():
        start = np.eye(3) if "fy" in held else None
        rms, k, d, _, _, sigma, _, per_view = cv2.calibrateCameraExtended(
            [board] * len(views), views, size, start, None, flags=flags)
        models[held] = {
            "rms_px": rms, "focal_px": [k[0, 0], k[1, 1]], "principal_px": [k[0, 2] + 0.5, k[1, 2] + 0.5],
            "distortion": d.ravel()[:5].tolist(), "sigma": sigma.ravel()[:9].tolist(),
            "view_rms_px": per_view.ravel().tolist(),
        }
    return models


def camera(folder, side):
    names, usual, wide = [], [], []
    for path in sorted(glob.glob(os.path.join(folder, side + "[0-9]*.jpg"))):
        size, a, b = find(path)
        names.append(os.path.basename(path))
        usual.append(a)
        wide.append(b)
    if not names:
        sys.exit(f"{folder}: no {side}*.jpg in it")
    return {
        "size": list(size), "names": names,
        "corners_px": [[[round(float(v) + 0.5, 4) for v in p] for p in view.reshape(-1, 2)] for view in usual],
        "usual_window": calibrate(size, usual), "product_window": calibrate(size, wide),
    }


def close(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(close(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(close(x, y) for x, y in zip(a, b))
    return a == b if isinstance(a, str) else abs(a - b) <= 1e-3 * max(abs(a), abs(b), 1e-2)


def main():
    check = "--check" in sys.argv
    rest = [a for a in sys.argv[1:] if a != "--check"]
    shared = os.environ.get("RIGD_SHARED", os.path.join(HERE, "..", "..", "..", "shared"))
    folder = os.path.join(rest[0] if rest else os.path.join(shared, "data"), "chessboard")
    made = {"opencv": cv2.__version__, "columns": COLUMNS, "rows": ROWS, "square_mm": SQUARE_MM,
            "left": camera(folder, "left"), "right": camera(folder, "right")}
    if check:
        if not close(made, json.load(open(FILE))):
            sys.exit("camera.json differs from what OpenCV gives")
        print("camera.json is what OpenCV gives")
        return
    with open(FILE, "w") as out:
        json.dump(made, out, separators=(",", ":"))
        out.write("\n")
    for side in ("left", "right"):
        for window in ("usual_window", "product_window"):
            for held, m in made[side][window].items():
                print(f"{side} {window} held {held}: rms {m['rms_px']:.5f} px, f {m['focal_px'][0]:.3f} {m['focal_px'][1]:.3f}")


if __name__ == "__main__":
    main()
