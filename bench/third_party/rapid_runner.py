"""OpenCV contrib's `rapid` module as a program for uavbench: python rapid_runner.py METHOD POINTS SEARCH_PX ITERATIONS.

SEARCH_PX is 0 for the default, a share of the image's width. Runs in its own environment, because only opencv-contrib
has this module; it depends on numpy and OpenCV alone. Its folder holds camera.toml, model.obj and init.toml
(docs/external-trackers.md).
"""

import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

METHODS = {"rapid": "Rapid", "gos": "GOSTracker", "ols": "OLSTracker"}
SEARCH_SHARE = 1 / 32
"""Default search range as a share of the image's width, 20 px of 640.

In the images of `uavbench check`, 160 px wide, 20 px span the whole box: the first pose is 1.2 m off with them, 6 cm
with 5 px.
"""


def read_toml(name: str) -> dict[str, Any]:
    """Content of a TOML file."""
    return tomllib.loads(Path(name).read_text(encoding="utf-8"))


def read_model() -> tuple[Any, Any]:
    """Vertices (n, 3) and triangles (m, 3)."""
    rows = [line.split() for line in Path("model.obj").read_text(encoding="utf-8").splitlines()]
    points = np.array([row[1:] for row in rows if row[0] == "v"], dtype=np.float32)
    triangles = np.array([row[1:] for row in rows if row[0] == "f"], dtype=np.int32) - 1
    return points, triangles


def search_range(search_px: int, width: int) -> int:
    """Search range in px in an image of a width in px; search_px: the range asked for, 0 for the default."""
    return search_px or max(2, round(SEARCH_SHARE * width))


def straightener(camera: dict[str, Any], K: Any) -> Callable[[Any], Any]:
    """A function that undistorts an image, since the module has no distortion model."""
    size, D = (camera["width"], camera["height"]), np.array(camera["distortion"])
    if camera["distortion_model"] == "none":
        return lambda image: image
    if camera["distortion_model"] == "radtan":
        maps = cv2.initUndistortRectifyMap(K, D, None, K, size, cv2.CV_32FC1)
    else:
        maps = cv2.fisheye.initUndistortRectifyMap(K, D, np.eye(3), K, size, cv2.CV_32FC1)
    return lambda image: cv2.remap(image, *maps, cv2.INTER_LINEAR)


def quaternion(m: Any) -> Any:
    """Quaternion, w first, of a rotation matrix (Shepperd 1978)."""
    q = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    if q[0] < 1:
        i = int(np.argmax(np.diag(m)))
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.zeros(4)
        q[1 + i] = 1 + m[i, i] - m[j, j] - m[k, k]
        q[0], q[1 + j], q[1 + k] = m[k, j] - m[j, k], m[i, j] + m[j, i], m[i, k] + m[k, i]
    return q / np.linalg.norm(q)


def main() -> None:
    """Track frame by frame, from standard input to standard output."""
    method, points, search_px, iterations = sys.argv[1], *map(int, sys.argv[2:])
    camera = read_toml("camera.toml")
    search_px = search_range(search_px, camera["width"])
    K = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    module: Any = vars(cv2)["rapid"]
    tracker = getattr(module, METHODS[method]).create(*read_model())
    straighten = straightener(camera, K)
    first = np.array(read_toml("init.toml")["cam_from_model"])
    pose = cv2.Rodrigues(first[:3, :3])[0], first[:3, 3:].copy()
    print("ready", flush=True)
    for line in sys.stdin.buffer:
        kind, *words = line.decode().strip().split(",")
        if kind != "frame":
            continue
        stamp_ns, width, height, channels = map(int, words)
        pixels = sys.stdin.buffer.read(width * height * channels)
        image = straighten(np.frombuffer(pixels, np.uint8).reshape(height, width, channels))
        stop = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, iterations, 1.5)  # the module's default precision
        try:
            share, r, t = tracker.compute(image, points, search_px, K, pose[0].copy(), pose[1].copy(), stop)
        except cv2.error as error:
            print(error, file=sys.stderr)
            share, r, t = 0.0, *pose
        if share > 0 and np.isfinite(r).all() and np.isfinite(t).all():
            pose = r, t
            numbers = [*t.ravel().tolist(), *quaternion(cv2.Rodrigues(r)[0]).tolist()]
            print(f"{stamp_ns},ok," + ",".join(map(repr, numbers)), flush=True)
        else:
            print(f"{stamp_ns},lost", flush=True)


if __name__ == "__main__":
    main()
