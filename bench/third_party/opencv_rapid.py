"""`opencv-rapid`: the module `rapid` of OpenCV contrib, in its own virtual environment.

uavbench's OpenCV is built without contrib, and in OpenCV 5 the module's GOS and OLS trackers fail an assertion.
"""

import os
import shutil
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge

from uavbench.bench.third_party.tracker import SETUP, VERSIONS, ThirdPartyTracker
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.seals import sealed_kind
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.processes.guard import Guard, finished

MARKER = "uavbench.json"
"""Marker file of the environment, written before anything else."""
RUNNER = Path(__file__).parent / "rapid_runner.py"
PACKAGES = ("opencv-contrib-python-headless==4.14.0.94", "numpy==2.4.6")


@dataclass(frozen=True)
class OpencvRapid(ThirdPartyTracker):
    """OpenCV contrib's RAPID (Harris & Stennett 1990), GOS or OLS tracker.

    points: control points on the model's silhouette; search_px: search range to either side of each, by default a 32nd
    of the image's width; iterations: at most, per frame.
    """

    name: ClassVar[str] = "opencv-rapid"
    pixels: ClassVar[Literal["bgr", "grey"]] = "bgr"

    method: Literal["rapid", "gos", "ols"] = "rapid"
    points: Annotated[int, Ge(4)] = 100
    search_px: Annotated[int, Ge(2)] | None = None
    iterations: Annotated[int, Ge(1)] = 20

    def command(self) -> tuple[str, ...]:
        """The environment's Python, the runner, and its arguments."""
        numbers = map(str, (self.points, self.search_px or 0, self.iterations))
        return (str(self.folder() / "venv" / "bin" / "python"), str(RUNNER), self.method, *numbers)

    @classmethod
    def recipe(cls) -> str:
        """The packages of its environment."""
        return " ".join(PACKAGES)

    @classmethod
    def setup(cls) -> dict[str, str]:
        """Create the environment and install tested versions of the runner's dependencies; UserError on failure."""
        folder, marker = cls.folder() / "venv", cls.folder() / VERSIONS
        _empty(folder)
        if sealed_kind(marker) == SETUP:
            marker.unlink()  # of the environment that was emptied
        try:
            venv.create(folder, with_pip=True)
        except (OSError, subprocess.CalledProcessError) as error:
            raise UserError(f"opencv-rapid: {folder}: cannot be made: {error}; is python3-venv installed?") from None
        python = str(folder / "bin" / "python")
        with Guard("uavbench-setup-") as guard:
            done = finished(
                guard, [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *PACKAGES], os.environ
            )
        if done.code:
            raise UserError(f"opencv-rapid: pip cannot install {' '.join(PACKAGES)}: {done.last}")
        subprocess.run([python, "-c", "import cv2; cv2.rapid.OLSTracker_create"], check=True)
        return {"python": sys.version.split()[0], **dict(package.split("==") for package in PACKAGES)}


def _empty(folder: Path) -> None:
    """Empty the folder of an earlier environment; UserError when it was not made by `setup`."""
    ours = not folder.is_symlink() and sealed_kind(folder / MARKER) == SETUP
    if os.path.lexists(folder) and not ours:
        raise UserError(f"{folder}: is not as `uavbench third-party setup` made it; move it away")
    write_text(folder / MARKER, '{\n "made": "by uavbench third-party setup"\n}\n', kind=SETUP)
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != MARKER:
            path.unlink()
