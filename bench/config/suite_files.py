"""The suites that come with uavbench, by name."""

import tomllib
from pathlib import Path

from uavbench.trajectories.errors import UserError, unknown_name

SUITES = Path(__file__).parents[1] / "suites"


def suite_names() -> list[str]:
    """Names of the suites that come with uavbench."""
    return sorted(path.stem for path in SUITES.glob("*.toml"))


def suite_title(name: str) -> str:
    """Title of a suite that comes with uavbench."""
    return str(tomllib.loads((SUITES / f"{name}.toml").read_text(encoding="utf-8"))["title"])


def suite_file(suite: str) -> Path:
    """File of a suite given by its name or by the path of a TOML file; UserError when there is none."""
    if suite.endswith(".toml") or "/" in suite:
        return Path(suite)
    if suite not in suite_names():
        raise UserError(f"{unknown_name('suite', suite, suite_names())}; a file of your own ends in .toml")
    return SUITES / f"{suite}.toml"
