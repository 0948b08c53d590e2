"""What `sequence.json` may say: the kinds of its values, checked once when a sequence is opened."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uavbench.trajectories.errors import UserError

POSITIVE = ("rate_hz", "depth_m_per_unit")
TABLES = ("config", "deviation", "versions")
LONGEST_NS = 10**18
"""Of a delay or a shift of clocks: thirty years."""
SHOWN = 60
"""Characters of a wrong value that are told."""


def check_info(path: Path, info: Mapping[str, Any]) -> None:
    """UserError naming the key of `sequence.json` whose value is none that a sequence has."""
    for key in POSITIVE:
        if not (_is_number(value := info.get(key, 1.0)) and 0 < value < float("inf")):
            raise _wrong(path, key, value, "a positive number")
    if not (_is_number(value := info.get("row_delay_ns", 0.0)) and 0 <= value <= LONGEST_NS):
        raise _wrong(path, "row_delay_ns", value, "a number of ns")
    shift = info.get("timeshift_cam_imu_ns", 0)
    if isinstance(shift, bool) or not isinstance(shift, int) or abs(shift) > LONGEST_NS:
        raise _wrong(path, "timeshift_cam_imu_ns", shift, "whole ns")
    for key in TABLES:
        if not isinstance(value := info.get(key) or {}, dict):
            raise _wrong(path, key, value, "a table")
    effects = (info.get("config") or {}).get("effects") or ()
    if not (isinstance(effects, list | tuple) and all(isinstance(effect, dict) for effect in effects)):
        raise _wrong(path, "config.effects", effects, "a list of tables")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _wrong(path: Path, key: str, value: Any, expected: str) -> UserError:
    shown = repr(value)
    return UserError(f"{path}: {key} = {shown[:SHOWN]}{'...' if len(shown) > SHOWN else ''}: must be {expected}")
