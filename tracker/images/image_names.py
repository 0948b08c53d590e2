"""What the names of images tell of their times, which a folder of images does not have."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError

STAMP_DIGITS = 12
"""Digits of a number from which on it is a time in ms, us or ns since 1970, and no count of images."""
UNITS = (1e3, 1e6, 1e9)
"""Steps of such numbers in a second."""
JITTER, DRIFT = 0.1, 0.01
"""Shares by which one step of these times, and their mean, may differ from the rate's: whole ms at 60 Hz are 6 %."""


def by_numbers(name: str) -> list[str | int]:
    """Texts and numbers of a name, in turn: a text first, which may be empty."""
    return [int(part) if place % 2 else part for place, part in enumerate(re.split(r"([0-9]+)", name))]


def refuse_twins(images: Sequence[Path]) -> None:
    """UserError for two images whose names differ only in their type, as of a camera that writes two files of each."""
    seen: dict[str, Path] = {}
    for path in images:
        other = seen.setdefault(path.stem, path)
        if other is not path:
            raise UserError(
                f"{path.parent}: has {other.name} and {path.name}, which would count as two images; keep one type"
            )


def doubts_of_names(images: Sequence[Path], rate_hz: float) -> list[str]:
    """Messages on images in order of their names that seem to be missing, of several cameras, or to have own times.

    They are taken 1 / rate_hz apart whatever their names say.
    """
    parts = [by_numbers(path.stem) for path in images]
    texts = [part[::2] for part in parts]
    other = next((k for k, text in enumerate(texts) if text != texts[0]), 0)
    if other:
        return [
            f"{images[0].parent}: {images[other].name} follows {images[other - 1].name}: if these are of different "
            "cameras or flights, put them into folders of their own"
        ]
    columns = [column for column in zip(*(part[1::2] for part in parts), strict=True) if len(set(column)) > 1]
    if len(columns) != 1:
        return []
    numbers = [int(number) for number in columns[0]]
    steps = np.array([float(after - before) for before, after in pairwise(numbers)])
    taken = f"the images are taken 1 / {rate_hz:g} s apart"
    if len(str(numbers[-1])) >= STAMP_DIGITS:
        if any(_fits(steps / unit * rate_hz) for unit in UNITS):
            return []
        return [
            f"{images[0].parent}: the names of the images look like times ({images[0].name}), which are not read: "
            f"{taken}; correct the rate, or give a video or a bag with these times"
        ]
    gaps = np.flatnonzero(steps > steps.min())
    if not len(gaps):
        return []
    k = int(gaps[0])
    more = f", and after {len(gaps) - 1} more there is a gap, too" if len(gaps) > 1 else ""
    return [
        f"{images[k].parent}: after {images[k].name} comes {images[k + 1].name}{more}: if images are missing, the "
        f"times are wrong from there on, since {taken}; copy the one before into each gap, or track each part by itself"
    ]


def _fits(steps: NDArray[np.float64]) -> bool:
    """Whether steps of times are those of the rate; as shares of these."""
    return bool((np.abs(steps - 1) < JITTER).all() and abs(steps.mean() - 1) < DRIFT)
