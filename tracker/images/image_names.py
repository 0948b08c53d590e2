"""What the names of images tell of their times, which a folder of images does not have."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError

STAMP_DIGITS = 12
"""Digits of a number from which on it is a time in ms, us or ns since 1970, and no count of images."""
MOST_STAMP_DIGITS = 19
"""Digits of ns since 1970 until 2261, the largest that 64 bits hold."""
UNITS = (1e3, 1e6, 1e9)
"""Steps of such numbers in a second."""
SECONDS = re.compile(r"((?:.*[^0-9])?)([0-9]+)\.([0-9]+)([^0-9]*)")
"""Name whose last number has decimals, or that ends in two numbers, as of a take and its images."""
WHOLE_SECONDS = re.compile(r"((?:.*[^0-9.])?)([0-9]+)([^0-9]*)")
"""Name with a whole number in the place of these: many programs write 0 and 0.5, not 0.0 and 0.5."""
EXPONENT = r"[0-9]+(?:\.[0-9]+[eE][-+]?|[eE][-+])[0-9]{1,2}"
"""Number with an exponent, as programs write small seconds: `5e-05`, `1.3E9`; in `1e10` a letter parts two counts."""
PLAIN = re.compile(rf"{EXPONENT}|[0-9]+(?:\.[0-9]+)?")
"""Name that is one number, with an exponent or without."""
EPOCH_DIGITS, MOST_COUNTED_DIGITS = 10, 8
"""Digits of whole seconds since 1970 from 2001 on; of the largest count of images behind a point."""
DATE_TIME = re.compile(
    r"(?<![0-9])((?:19|20)\d\d)([-_.]?)(\d\d)\2(\d\d)[-_ T.]*(\d\d)([-_.]?)(\d\d)\6(\d\d)(?:\.?(\d{3}))?(?![0-9])",
    re.ASCII,
)
"""Date and time of day, perhaps with ms: `DJI_20240131120005_0001`, `IMG_20240131_120005`, `2024-01-31-12-00-05`."""
SECOND, MILLISECOND = 1.0, 1e-3
"""Steps of times of day in s, without and with ms."""
OFF_COUNT = 0.5
"""Steps by which the time between two images may differ from that of their numbers."""
JITTER, DRIFT = 0.1, 0.01
"""Shares by which one step of these times, and their mean, may differ from the rate's: whole ms at 60 Hz are 6 %."""


def by_numbers(name: str, seconds: bool = False) -> list[str | Decimal]:
    """Texts and numbers of a name, in turn: a text first, which may be empty.

    seconds: the last number has decimals, or the whole name is one with an exponent.
    """
    decimals = rf"\A{EXPONENT}\Z|[0-9]+\.[0-9]+(?![0-9]|\.[0-9])|" if seconds else ""
    parts = re.split(f"({decimals}[0-9]+)", name)
    return [Decimal(part) if place % 2 else part for place, part in enumerate(parts)]


def in_seconds(images: Sequence[Path]) -> bool:
    """Whether the names end in seconds with decimals, as in TUM RGB-D: `0.2` comes after `0.133333` then.

    So do names that are numbers, some with an exponent: `0.0`, `5e-05`, `0.0001`.

    Two counts, as of takes and their images, are no such: counts are as wide as each other, or have no zeros in front
    and are not evenly apart if read as seconds. Those of takes do not go on from 9 with 0 of the next one.
    """
    stems = [path.stem for path in images]
    if any(re.fullmatch(EXPONENT, stem) for stem in stems) and all(map(PLAIN.fullmatch, stems)):
        return True
    found = [SECONDS.fullmatch(stem) for stem in stems]
    pairs = [(each[2], each[3]) for each in found if each]
    if not pairs:
        return False
    if len(pairs) < len(found):
        around = {(each[1], each[4]) for each in found if each}
        others = [WHOLE_SECONDS.fullmatch(path.stem) for path, each in zip(images, found, strict=True) if each is None]
        whole = [(each[2], "") for each in others if each and (each[1], each[3]) in around]
        pairs += whole
        if len(around) > 1 or len(whole) < len(others) or len({Decimal(".".join(pair)) for pair in pairs}) < len(pairs):
            return False
    if any(len(whole) >= EPOCH_DIGITS or len(part) > MOST_COUNTED_DIGITS for whole, part in pairs):
        return True
    if len({len(part) for _, part in pairs}) > 1:
        steps_s = np.diff(sorted(float(f"{whole}.{part}") for whole, part in pairs))
        even = len(steps_s) > 1 and np.ptp(steps_s) < JITTER * steps_s.mean()
        return bool(even) or any(part.startswith("0") and len(part) > 1 for _, part in pairs)
    counts = sorted((int(whole), int(part)) for whole, part in pairs)
    if counts[0][0] == counts[-1][0]:
        return False
    steps = {after[1] - before[1] for before, after in pairwise(counts) if after[0] == before[0]}
    return bool(steps - {1}) or {
        int(after) - int(before) for before, after in pairwise(sorted(map("".join, pairs)))
    } == {1}


def refuse_twins(images: Sequence[Path]) -> None:
    """UserError for two images whose names differ only in their type, as of a camera that writes two files of each."""
    seen: dict[str, Path] = {}
    for path in images:
        other = seen.setdefault(path.stem, path)
        if other is not path:
            raise UserError(
                f"{path.parent}: has {other.name} and {path.name}, which would count as two images; keep one type"
            )


def stamps_in_names(images: Sequence[Path]) -> NDArray[np.int64] | None:
    """Stamps (n,) in ns of images whose names end in seconds with decimals, or count ms, us or ns since 1970.

    None for other names, as counts and dates, and for times that do not increase.
    """
    seconds = in_seconds(images)
    last = [by_numbers(path.stem, seconds)[1::2][-1:] for path in images]
    numbers = [Decimal(number) for found in last for number in found]
    if len(numbers) < len(images):
        return None
    digits = len(str(int(numbers[-1])))
    if (not seconds and digits < STAMP_DIGITS) or digits > MOST_STAMP_DIGITS or _dates(images) is not None:
        return None
    unit_ns = 10**9 if seconds else next(10 ** (9 - k) for k in (3, 6, 9) if digits <= STAMP_DIGITS + k - 1 or k == 9)
    whole_ns = [int(number * unit_ns) for number in numbers]
    if max(whole_ns) > np.iinfo(np.int64).max:
        return None
    stamps_ns = np.array(whole_ns, dtype=np.int64)
    return stamps_ns if (np.diff(stamps_ns) > 0).all() else None


def doubts_of_order(images: Sequence[Path]) -> list[str]:
    """Message on images of a folder that are given in another order than that of the numbers in their names."""
    seconds = in_seconds(images)
    for before, after in pairwise(images):
        first, second = by_numbers(before.stem, seconds), by_numbers(after.stem, seconds)
        if before.parent == after.parent and first[::2] == second[::2] and second < first:
            return [
                f"{before.parent}: {after.name} is given after {before.name}: images are taken in the order in which "
                "they are given; where that is not the order of time, sort them"
            ]
    return []


def doubts_of_names(images: Sequence[Path], rate_hz: float) -> list[str]:
    """Messages on images in order of their names that seem to be missing, of several cameras, or to have own times.

    They are taken 1 / rate_hz apart whatever their names say.
    """
    taken = f"the images are taken 1 / {rate_hz:g} s apart"
    times = (
        f"{images[0].parent}: the names of the images look like times ({images[0].name}), which are not read: "
        f"{taken}; correct the rate, or give a video or a bag with these times"
    )
    seconds = in_seconds(images)
    parts = [by_numbers(path.stem, seconds) for path in images]
    texts = [part[::2] for part in parts]
    if back := doubts_of_order(images):
        return back
    other = next((k for k, text in enumerate(texts) if text != texts[0]), 0)
    if other:
        return [
            f"{images[0].parent}: {images[other].name} follows {images[other - 1].name}: if these are of different "
            "cameras or flights, put them into folders of their own"
        ]
    dates = _dates(images)
    if dates is not None:
        return [] if dates.are_of(rate_hz) else [times]
    columns = list(zip(*(part[1::2] for part in parts), strict=True))
    stamps = columns[-1:] if seconds else [each for each in columns if len(str(each[-1])) >= STAMP_DIGITS]
    changing = [column for column in columns if len(set(column)) > 1]
    for column in (each for each in changing if each in stamps):
        told = any(fits(_steps(column) / unit * rate_hz) for unit in ((1.0,) if seconds else UNITS))
        return [] if told else [times]
    if len(changing) != 1:
        return []
    steps = _steps(changing[0])
    steps[[before.parent != after.parent for before, after in pairwise(images)]] = np.nan
    if np.isnan(steps).all():
        return []
    gaps = np.flatnonzero(steps > np.nanmin(steps))
    if not len(gaps):
        return []
    k = int(gaps[0])
    more = f", and after {len(gaps) - 1} more there is a gap, too" if len(gaps) > 1 else ""
    return [
        f"{images[k].parent}: after {images[k].name} comes {images[k + 1].name}{more}: if images are missing, the "
        f"times are wrong from there on, since {taken}; copy the one before into each gap, or track each part by itself"
    ]


def doubts_of_counts(images: Sequence[Path], stamps_ns: NDArray[np.int64], name: str) -> list[str]:
    """Message on images whose numbers have other gaps than the stamps (n,) that they have by their order.

    name: of the file of the stamps. Numbers are compared where one in each name changes, and is no time.
    """
    parts = [by_numbers(path.stem) for path in images]
    if any(part[::2] != parts[0][::2] for part in parts) or len(images) < 3:
        return []
    changing = [each for each in zip(*(part[1::2] for part in parts), strict=True) if len(set(each)) > 1]
    if len(changing) != 1 or len(str(changing[0][-1])) >= STAMP_DIGITS:
        return []
    counted, times = _steps(changing[0]), np.diff(stamps_ns)
    if not counted.any():
        return []
    per_count = np.median(times[counted != 0] / counted[counted != 0])
    off = np.flatnonzero(np.abs(times / per_count - counted) > OFF_COUNT)
    if not len(off) or not np.ptp(counted):
        return []
    k = int(off[0])
    return [
        f"{images[k].parent}: after {images[k].name} comes {images[k + 1].name}, and {name} has poses "
        f"{times[k] / 1e9:.4g} s apart in their places, where {counted[k] * per_count / 1e9:.4g} s are expected: poses "
        "are paired with images in order, and are others from there on if either misses some; give the poses of these "
        "images alone, or name the images by their times"
    ]


@dataclass(frozen=True, eq=False)
class _Dates:
    """Times (n,) of images by dates in their names, in s since the first one, and what they are rounded to."""

    seconds: NDArray[np.float64]
    step_s: float

    def are_of(self, rate_hz: float) -> bool:
        """Whether images 1 / rate_hz apart have these times."""
        taken = np.arange(len(self.seconds)) / rate_hz
        return bool((np.abs(self.seconds - taken) <= self.step_s + JITTER / rate_hz + DRIFT * taken).all())


def _dates(images: Sequence[Path]) -> _Dates | None:
    """Times of images whose names all have one date and time of day; None for other names, or one time for all."""
    found = [DATE_TIME.search(path.stem) for path in images]
    matches = [each for each in found if each]
    if len(matches) < len(found):
        return None
    try:
        moments = [datetime(*(int(each[k]) for k in (1, 3, 4, 5, 7, 8))) for each in matches]  # type: ignore[arg-type]
    except ValueError:  # no day of a month
        return None
    seconds = np.array(
        [
            (moment - moments[0]).total_seconds() + int(each[9] or 0) / 1e3
            for moment, each in zip(moments, matches, strict=True)
        ]
    )
    whole = any(each[9] is None for each in matches)
    return _Dates(seconds - seconds[0], SECOND if whole else MILLISECOND) if np.ptp(seconds) else None


def _steps(numbers: Sequence[str | Decimal]) -> NDArray[np.float64]:
    """Steps (n - 1,) between numbers, which may be too large for floats."""
    return np.array([float(Decimal(after) - Decimal(before)) for before, after in pairwise(numbers)])


def fits(steps: NDArray[np.float64]) -> bool:
    """Whether steps of times are those of the rate; as shares of these."""
    return bool((np.abs(steps - 1) < JITTER).all() and abs(steps.mean() - 1) < DRIFT)
