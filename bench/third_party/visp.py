"""`visp`: the generic model-based tracker of ViSP (Comport et al. 2006; Trinh et al. 2018), from Debian's packages.

ViSP is under the GPL: the runner is compiled and linked on the user's machine, and communicates over pipes.
"""

import hashlib
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt

from uavbench.bench.third_party.tracker import ThirdPartyTracker
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.origin import owning
from uavbench.trajectories.files.writing import new_file
from uavbench.trajectories.processes.guard import Guard, finished

SOURCE = Path(__file__).parent / "visp_runner.cpp"
PACKAGES = ("g++", "libvisp-dev")
VISP = ("visp_mbt", "visp_vision", "visp_klt", "visp_me", "visp_io", "visp_core")
OPENCV = ("opencv_calib3d", "opencv_imgproc", "opencv_core")


@dataclass(frozen=True)
class Visp(ThirdPartyTracker):
    """ViSP's model-based tracker on edges, on KLT points of the faces, or on both.

    range_px, edge_threshold, sample_step_px: parameters of its moving edges, by default those of its tutorial.
    scanline: visibility test by scan lines instead of per face; without it, occluded edges are tracked too.
    """

    name: ClassVar[str] = "visp"

    features: Literal["edge", "klt", "edge+klt"] = "edge"
    range_px: Annotated[int, Ge(1)] = 8
    edge_threshold: Annotated[float, Gt(0)] = 10000.0
    sample_step_px: Annotated[float, Gt(0)] = 4.0
    scanline: bool = True

    def command(self) -> tuple[str, ...]:
        """The runner and its arguments."""
        numbers = (self.range_px, self.edge_threshold, self.sample_step_px, int(self.scanline))
        return (str(self.folder() / "visp_runner"), self.features, *map(str, numbers))

    @classmethod
    def recipe(cls) -> str:
        """Hash of the runner's source, which the compiled one must follow."""
        return hashlib.sha256(SOURCE.read_bytes()).hexdigest()

    @classmethod
    def setup(cls) -> dict[str, str]:
        """Compile the runner against the system's ViSP, installed first when run as root; UserError on failure."""
        headers = _headers() or _install()
        folder = cls.folder()
        runner = folder / "visp_runner"
        with owning([runner]), new_file(runner) as new:
            build = ["g++", "-O2", "-std=c++17", f"-I{headers}", "-I/usr/include/opencv4", "-o", str(new)]
            build += [str(SOURCE), *(f"-l{name}" for name in VISP + OPENCV)]
            with Guard("uavbench-setup-") as guard:
                done = finished(guard, build, os.environ)
            if done.code:
                raise UserError(
                    f"visp: the runner cannot be compiled: {done.last}; needs the packages {' '.join(PACKAGES)}"
                )
        runner.chmod(0o755)
        return {"visp": _value(headers / "visp3/core/vpConfig.h", "VISP_VERSION")}


def _headers() -> Path | None:
    """Folder with ViSP's headers; None when they or the compiler are missing."""
    if shutil.which("g++") is None:
        return None
    places = (Path("/usr/local/include"), Path("/usr/include"), *sorted(Path("/usr/include").glob("*-linux-gnu")))
    return next((path for path in places if (path / "visp3/mbt/vpMbGenericTracker.h").is_file()), None)


def _install() -> Path:
    """Install Debian's packages as root; for other users a UserError with the command to run."""
    line = f"apt-get install -y --no-install-recommends {' '.join(PACKAGES)}"
    if os.geteuid() == 0 and shutil.which("apt-get"):
        for command in ("apt-get update -qq", line):
            subprocess.run(command.split(), check=False, env={**os.environ, "DEBIAN_FRONTEND": "noninteractive"})
    headers = _headers()
    if headers is None:
        raise UserError(f"visp: its headers are missing; on Debian or Ubuntu type: sudo {line}")
    return headers


def _value(header: Path, name: str) -> str:
    """Value of a macro in a header; "" when it is not defined."""
    lines = (line.split(None, 2) for line in header.read_text(encoding="utf-8").splitlines())
    return next((words[2].strip('"') for words in lines if words[:2] == ["#define", name] and len(words) > 2), "")
