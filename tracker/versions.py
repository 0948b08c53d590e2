"""Versions of the libraries that results depend on; imports no other module, so evaluation loads no tracker."""

import platform
from importlib.metadata import PackageNotFoundError, version

import cv2
import numpy as np


def versions() -> dict[str, str]:
    """Versions of the libraries that a tracker's results depend on, by name."""
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
