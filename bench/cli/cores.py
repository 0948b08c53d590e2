"""The option `--jobs`: number of parallel processes."""

import os
from collections.abc import Callable
from typing import Any

import click

CORES = len(os.sched_getaffinity(0))
"""Number of cores that this process may use; a batch queue or `taskset` may limit it."""


def jobs_option(about: str = "Processes") -> Callable[[Any], Any]:
    """Add `--jobs`, by default one process for each core that may be used."""
    return click.option(
        "--jobs", type=click.IntRange(1), default=CORES, help=f"{about}; default: all cores it may use."
    )
