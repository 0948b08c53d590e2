"""Base class of third-party trackers: programs that have to be set up on a machine before they can run."""

import json
import os
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from uavbench.bench.external.isolation import THREADS
from uavbench.bench.external.program import External
from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Run
from uavbench.tracker.run import parameters
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Pose

SETUP = "setup of a tracker"
VERSIONS, RECIPE = "versions.json", "recipe"


class ThirdPartyTracker(ABC):
    """A tracker by other authors: a frozen dataclass of its parameters, with `command`.

    It is unavailable until `uavbench third-party setup NAME` has set it up. Then its folder holds `versions.json` with
    the versions of its components, which are part of the hash of every result, and the `recipe` that it was made by.
    """

    name: ClassVar[str]
    entering_variables: ClassVar[tuple[str, ...]] = THREADS
    pixels: ClassVar[Literal["bgr", "grey"]] = "grey"

    @classmethod
    def folder(cls) -> Path:
        """Folder in which it is set up: `$UAVBENCH_THIRD_PARTY/NAME`, by default in the user's cache."""
        cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111, raises nothing
        return Path(os.environ.get("UAVBENCH_THIRD_PARTY") or f"{cache}/uavbench/third-party") / cls.name

    @classmethod
    def absence(cls) -> str:
        """Reason why it is not available on this machine; "" if it is."""
        how = f"`uavbench third-party setup {cls.name}`"
        if not (cls.folder() / VERSIONS).is_file():
            return f"not set up on this machine; {how} does it"
        if cls._marked().get(RECIPE) != cls.recipe():
            return f"set up by another version of uavbench, which runs it in another way; {how} renews it"
        return ""

    @classmethod
    @abstractmethod
    def recipe(cls) -> str:
        """What `setup` makes it from, as text: what was made by another recipe is not used."""

    @classmethod
    @abstractmethod
    def setup(cls) -> dict[str, str]:
        """Set it up on this machine; the versions of its components. UserError saying what to install."""

    @classmethod
    def mark(cls, versions: dict[str, str]) -> None:
        """Write `versions.json`, which marks it as set up."""
        about = {**versions, RECIPE: cls.recipe()}
        write_text(cls.folder() / VERSIONS, json.dumps(about, indent=1, sort_keys=True) + "\n", kind=SETUP)

    @classmethod
    def _marked(cls) -> dict[str, Any]:
        """What `mark` wrote; empty for a file that does not hold it."""
        with suppress(ValueError, OSError):
            about = json.loads((cls.folder() / VERSIONS).read_text(encoding="utf-8"))
            return about if isinstance(about, dict) else {}
        return {}

    @abstractmethod
    def command(self) -> tuple[str, ...]:
        """Program and arguments."""

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """Files whose content is hashed into every result."""
        marker = self.folder() / VERSIONS
        return (*self.program.entering_files, marker) if marker.is_file() else ()

    @property
    def record(self) -> dict[str, Any]:
        """The tracker's entry in the record of a run."""
        versions = {name: value for name, value in self._marked().items() if name not in (RECIPE, "made_by")}
        return {"kind": self.name, "parameters": parameters(self), "versions": versions}

    @property
    def program(self) -> External:
        """The program as an external tracker."""
        return External(command=self.command(), pixels=self.pixels)

    def present(self) -> External:
        """The program; UserError when the tracker is not available."""
        if why := self.absence():
            raise UserError(f"{self.name}: {why}")
        return self.program

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run; UserError when the tracker is not available."""
        return self.present().start(structure, camera, cam_from_world, rng)
