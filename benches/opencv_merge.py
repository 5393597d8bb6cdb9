#!/usr/bin/env python3
"""`rigd bench merge` and OpenCV (and libjpeg-turbo, where simplejpeg is installed) on the same frames, in one run.

    pip install opencv-python-headless simplejpeg
    cargo build --release
    python3 benches/opencv_merge.py target/release/rigd DIR

Times are of one thread's processor time; DIR takes the frames and 400 MB of EXR files."""
import statistics
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import cv2
import numpy as np

REPEATS = 5


def measured(name, work):
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        times.append(1e3 * (time.process_time() - begin))
    print(f"  {name:<44}{min(times):>7.1f} ms{statistics.median(times):>7.1f} ms", flush=True)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    rigd, directory = sys.argv[1], Path(sys.argv[2])
    subprocess.run([rigd, "bench", "merge", "--out", directory, "--repeats", str(REPEATS)], check=True)
    frames = tomllib.loads((directory / "exposures.toml").read_text())["frame"]
    files = [(directory / frame["file"]).read_bytes() for frame in frames]
    times = np.array([frame["time_s"] for frame in frames], np.float32)
    cv2.setNumThreads(1)
    print(f"OpenCV {cv2.__version__}, one thread")
    buffers = [np.frombuffer(data, np.uint8) for data in files]
    measured("decode one JPEG, imdecode", lambda: cv2.imdecode(buffers[4], cv2.IMREAD_COLOR))
    pictures = [cv2.imdecode(buffer, cv2.IMREAD_COLOR) for buffer in buffers]
    merge = cv2.createMergeDebevec()
    measured("merge 10 frames, MergeDebevec", lambda: merge.process(pictures, times))
    try:
        import simplejpeg
    except ImportError:
        print("libjpeg-turbo: not measured, simplejpeg is not installed")
        return
    print(f"libjpeg-turbo (simplejpeg {simplejpeg.__version__})")
    into = np.empty_like(pictures[4])
    # Its defaults are an inexact transform and differences of colour that are repeated instead of interpolated: no decoder for radiometry.
    exact = {"colorspace": "RGB", "fastdct": False, "fastupsample": False}
    measured("decode one JPEG, into memory that is there",
             lambda: simplejpeg.decode_jpeg(files[4], buffer=into, **exact))
    measured("the same, transform and colours fast",
             lambda: simplejpeg.decode_jpeg(files[4], colorspace="RGB", buffer=into, fastdct=True, fastupsample=True))


if __name__ == "__main__":
    main()
