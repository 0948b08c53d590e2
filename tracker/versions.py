"""Versions of the libraries that results depend on; imports nothing of ours, so evaluating loads no tracker."""

import platform
from importlib.metadata import PackageNotFoundError, version

import cv2
import numpy as np


def versions() -> dict[str, str]:
    """Versions of what a tracker's numbers depend on."""
    try:
        own = version("uavbench")
    except PackageNotFoundError:
        own = "source"
    return {
        "uavbench": own,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "numba": version("numba"),
    }
