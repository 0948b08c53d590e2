"""Blender as a separate program: its location, its version, and a scene open in it."""

import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.scenes.rendering.radiance import Radiance
from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.files.limits import FileLimit
from uavbench.trajectories.files.reading import read_bytes
from uavbench.trajectories.processes.guard import END_S, Guard, Talk, finished, talk_in

SCRIPT = Path(__file__).parent / "blender_script.py"
VARIABLE = "UAVBENCH_BLENDER"
OLDEST = (3, 1)
"""The first version with Python 3.10 and with mesh attributes for colours."""
INSTALL = f"on Debian or Ubuntu type: sudo apt-get install blender, or name its program in {VARIABLE}"
VERSION_S = 60.0
"""Timeout for printing the version, s; from a cold disk it takes a few seconds."""
LAST_LINES = 5
LAST_BYTES = 1 << 16
"""Bytes at the end of Blender's output in which its last lines are looked for."""
LONGEST_ANSWER = 1 << 16
"""Characters of a line of Blender's output; an answer has fewer than a hundred."""
PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "TMPDIR")
"""The only environment variables passed on to Blender: its Python must not import our libraries."""


@dataclass(frozen=True)
class Blender:
    """An installed Blender: path of the program, and its version, such as `3.4.1`."""

    program: str
    version: str


def find_blender() -> Blender:
    """The Blender that UAVBENCH_BLENDER names, or the one on PATH.

    UserError when it is absent, cannot be run, or is older than OLDEST.
    """
    wanted = os.environ.get(VARIABLE) or "blender"
    program = shutil.which(wanted)
    if program is None:
        raise UserError(f"blender: the program {wanted!r} is not installed; {INSTALL}")
    try:
        with Guard("uavbench-blender-") as guard:
            done = finished(guard, [program, "--version"], _environment(), VERSION_S)
    except TimeoutError as error:
        raise UserError(f"blender: {program} --version {error}; {INSTALL}") from None
    found = re.search(r"^Blender (\d+)\.(\d+)(\.\d+)?", done.out, re.MULTILINE)
    if done.code or found is None:
        raise UserError(f"blender: {program} prints no version: {_last(done.err or done.out)}; {INSTALL}")
    if tuple(map(int, found.groups()[:2])) < OLDEST:
        raise UserError(
            f"blender: {program} is {found[0]}, too old: at least {'.'.join(map(str, OLDEST))} is needed; {INSTALL}"
        )
    return Blender(program, found[0].removeprefix("Blender "))


class OpenScene:
    """A scene open in Blender, which renders one view per request; denoiser: its name, "" without one."""

    def __init__(self, guard: Guard, talk: Talk, log: int) -> None:
        self._guard, self._talk, self._log = guard, talk, log
        self.denoiser = str(self._reply().get("denoiser", ""))

    def light(self, request: Mapping[str, Any], width: int, height: int) -> Radiance:
        """Linear radiance (h, w, 3) float32 BGR of the view of a request to `blender_script.answer`.

        UserError when Blender ended or failed, or wrote no whole image.
        """
        path = self._guard.folder / "view.f32"
        path.unlink(missing_ok=True)
        try:
            print(json.dumps({**request, "file": str(path)}), file=self._talk.asks, flush=True)
        except BrokenPipeError:
            raise self._failure() from None
        self._reply()
        size = 4 * 4 * width * height
        data = read_bytes(path, FileLimit("view", size, "is it Blender?"), inside=self._guard.folder)
        light = np.frombuffer(data[: len(data) // 16 * 16], dtype="<f4").reshape(-1, 4)
        if len(data) != size or np.isnan(light).any():
            raise UserError(f"blender: its image has {len(data):,} of {size:,} bytes, or values that are not numbers")
        return np.ascontiguousarray(light.reshape(height, width, 4)[::-1, :, 2::-1])

    def _reply(self) -> dict[str, Any]:
        """Blender's next answer; its output before the script starts is skipped."""
        while line := self._talk.answers.readline(LONGEST_ANSWER):
            if line.startswith("{"):
                try:
                    answer: dict[str, Any] = json.loads(line)
                except (ValueError, RecursionError):
                    raise UserError(f"blender: answered {one_line(line)[:60]!r}; {INSTALL}") from None
                return answer
        raise self._failure()

    def _failure(self) -> UserError:
        ended = self._guard.wait(END_S)
        how = "closed its output and did not end" if ended is None else f"ended with exit code {ended.code}"
        first = max(0, os.fstat(self._log).st_size - LAST_BYTES)
        said = os.pread(self._log, LAST_BYTES, first).decode("utf-8", errors="replace")
        return UserError(f"blender: {how}; its last lines: {_last(said)}")


@contextmanager
def opened(blender: Blender, guard: Guard, samples: int) -> Iterator[OpenScene]:
    """The scene that `write_scene` wrote into a guard's folder, open in Blender on the CPU cores of this process.

    samples: per pixel. UserError when Blender fails.
    """
    threads = len(os.sched_getaffinity(0))
    command = [blender.program, "--background", "--factory-startup", "-noaudio", "--python-exit-code", "1"]
    command += ["--python", str(SCRIPT), "--", str(guard.folder), str(samples), str(threads)]
    with (
        (guard.folder / "stderr.txt").open("w+b") as log,
        talk_in(guard, command, _environment(), errors=log.fileno()) as talk,
    ):
        yield OpenScene(guard, talk, log.fileno())


def _environment() -> dict[str, str]:
    return {name: os.environ[name] for name in PASSED_ON if name in os.environ}


def _last(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return one_line(" | ".join(lines[-LAST_LINES:])) or "it said nothing"
