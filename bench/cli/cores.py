"""The option `--jobs`: how many processes work side by side."""

import os
from collections.abc import Callable
from typing import Any

import click

CORES = len(os.sched_getaffinity(0))
"""Cores that this process may use, which a queue or `taskset` may have limited."""


def jobs_option(about: str = "Processes") -> Callable[[Any], Any]:
    """Add `--jobs`, which defaults to one process for each core that may be used."""
    return click.option(
        "--jobs", type=click.IntRange(1), default=CORES, help=f"{about}; default: all cores it may use."
    )
