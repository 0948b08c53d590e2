"""Variables of the environment with which libraries cannot be imported: told, or set to what does no harm."""

import os
import re
from pathlib import Path

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.folders import temporary_folder

IN_FILES = "agg"
"""Backend of matplotlib that draws into files, as all commands do."""


def settle_environment() -> None:
    """Make the environment one in which every library can be imported.

    UserError for a NUMBA_NUM_THREADS that numba cannot be imported with.
    """
    check_numba_threads()
    settle_numexpr_threads()
    settle_matplotlib()


def check_numba_threads() -> None:
    """UserError for a NUMBA_NUM_THREADS that numba cannot be imported with."""
    count = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if re.fullmatch(r"[+-]?[0-9]+", count) and int(count) < 1:
        raise UserError(f"the environment variable NUMBA_NUM_THREADS is {count}; set it to 1 or more, or unset it")


def settle_numexpr_threads() -> None:
    """Give NumExpr, which pandas imports where it is installed, a number of threads that it can read.

    It fails for any other text, and for what OpenMP allows: one number for each level.
    """
    asked = os.environ.get("NUMEXPR_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS", "")
    first = asked.partition(",")[0].strip()
    if asked and not re.fullmatch(r"\s*\+?0*[1-9][0-9]*\s*", asked):
        os.environ["NUMEXPR_NUM_THREADS"] = first if first.isdecimal() and int(first) else "1"


def settle_matplotlib() -> None:
    """Replace a backend that matplotlib cannot be imported with, and keep its files elsewhere if the home is missing.

    It would make the home.
    """
    home = Path(os.path.expanduser("~"))  # noqa: PTH111, raises nothing
    if not home.is_dir() and not os.environ.get("MPLCONFIGDIR") and (folder := temporary_folder()):
        os.environ["MPLCONFIGDIR"] = str(folder / "matplotlib")
    if os.environ.get("MPLBACKEND", IN_FILES).lower() == IN_FILES:
        return
    backend = os.environ.pop("MPLBACKEND")  # an import that has failed cannot be made up for
    import matplotlib

    try:
        matplotlib.rcParams["backend"] = backend
    except ValueError:
        backend = IN_FILES
    os.environ["MPLBACKEND"] = backend
