"""The environment that produced results: versions, GL driver and processor."""

import platform
from pathlib import Path

from uavbench.scenes.dataset.table_files import read_json
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import DamagedFileError, UserError

CPUINFO = Path("/proc/cpuinfo")


def environment(folder: Path) -> dict[str, str]:
    """The environment of the scores in a suite's folder, as names and values.

    The versions are those of this Python, gl that of the folder's frames, and cpu that of this machine.
    """
    about = {**versions(), "system": f"{platform.system()} {platform.machine()}", "cpu": cpu()}
    return {**about, **({"gl": gl} if (gl := _gl(folder)) else {})}


def cpu() -> str:
    """Model name of the processor."""
    try:
        lines = CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _gl(folder: Path) -> str:
    """GL drivers that rendered the frames; "" without frames, or for recorded sequences."""
    drivers = set()
    for path in sorted((folder / "sequences").glob("*/sequence.json")):
        try:
            about = read_json(path).get("versions", {})
        except DamagedFileError:
            raise
        except UserError:
            continue
        drivers.add(str(about.get("gl", "")) if isinstance(about, dict) else "")
    return ", ".join(sorted(drivers - {""}))
