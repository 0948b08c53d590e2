"""The environment that produced results: versions, GL driver and processor."""

import platform
from collections.abc import Iterable
from pathlib import Path

from uavbench.bench.gate.paired_scores import Side
from uavbench.scenes.dataset.table_files import read_json
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import DamagedFileError, UserError

CPUINFO = Path("/proc/cpuinfo")
GL = "gl"


def environment(folder: Path, side: Side) -> dict[str, str]:
    """The environment of the scores in a suite's folder, as names and values.

    The versions are those with which the results were made, those of this Python where results do not tell; gl is the
    driver of their frames, and cpu that of this machine. Several of one kind are all named.
    """
    names = set(map(str, read_json(folder / "suite.json")["sequences"]))
    of_run = {key: name if (name := f"{key[1]}-s{key[2]}") in names else key[1] for key in side.runs}
    results = folder / ("flights" if side.is_flown else "results")
    ran = _versions(results / name / key[0] / "record.json" for key, name in of_run.items())
    rendered = _versions(folder / "sequences" / name / "sequence.json" for name in of_run.values())
    own = {name: _listed(ran, name) or version for name, version in versions().items()}
    about = {**own, "system": f"{platform.system()} {platform.machine()}", "cpu": cpu()}
    return {**about, **({GL: gl} if (gl := _listed(ran if side.is_flown else rendered, GL)) else {})}


def cpu() -> str:
    """Model name of the processor."""
    try:
        lines = CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _versions(files: Iterable[Path]) -> list[dict[str, object]]:
    """The versions that files tell: records of results, descriptions of sequences."""
    found = []
    for path in sorted(set(files)):
        try:
            about = read_json(path).get("versions", {})
        except DamagedFileError:
            raise
        except UserError:
            continue
        if isinstance(about, dict):
            found.append(about)
    return found


def _listed(found: Iterable[dict[str, object]], name: str) -> str:
    """All versions of a library among those found; "" without any."""
    return ", ".join(sorted({str(about.get(name, "")) for about in found} - {""}))
