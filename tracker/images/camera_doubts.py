"""Plausibility of a camera's principal point, whose conventions differ by half a pixel and by the image's size."""

import numpy as np

from uavbench.scenes.camera import Camera

SCALES = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 2, 2.0, 3.0, 4.0)
"""Ratios of sizes by which images are often resized."""
NEAR = 0.04
"""Distance of a principal point from the middle of such an image in parts of its size, as lenses have it."""


def doubts_of_camera(camera: Camera) -> list[str]:
    """Messages on a principal point half a pixel, or a usual factor of resized images, beside the image's middle."""
    middle = np.array([camera.width, camera.height]) / 2
    if (camera.cx, camera.cy) == tuple(middle):
        return [
            f"cx = {camera.cx:g} and cy = {camera.cy:g} are half of the image's size, as in COLMAP, where the first "
            f"pixel's centre is (0.5, 0.5); here it is (0, 0): subtract 0.5 from both, or calibrate the camera"
        ]
    beside = (np.array([camera.cx, camera.cy]) + 0.5) / (2 * middle)
    for scale in SCALES:
        if (np.abs(beside - scale / 2) < NEAR * scale).all():
            width, height = round(scale * camera.width), round(scale * camera.height)
            return [
                f"cx = {camera.cx:g} and cy = {camera.cy:g} are in the middle of an image of {width} x {height} px, "
                f"not of {camera.width} x {camera.height}: are fx, fy, cx and cy those of images before they were "
                "resized? Then scale them; of images that were cropped they are right"
            ]
    return []
