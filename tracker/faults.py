"""Messages on faults in a tracker's code, in one line: name, file and line."""

import math
import sys
import sysconfig
from dataclasses import replace
from numbers import Integral, Real
from pathlib import Path
from traceback import walk_tb
from types import CodeType, FrameType
from typing import Any

import numpy as np

from uavbench.tracker.protocol import STATUSES, TrackResult, is_rotation
from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.pose import Pose, read_only

OURS = frozenset({"uavbench"})
LIBRARIES = tuple({sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")})
COUNTS = ("segments", "control_points", "candidates", "inliers")
LEAST_EIGENVALUE = -1e-6
"""Tolerance for round-off: ratio of a covariance's smallest eigenvalue to its largest."""

ASYMMETRY = 1e-4
"""Largest difference of two elements of a covariance that should be equal, of its largest: of products in float32."""


class ResultError(Exception):
    """An invalid result of `track`: the fault's name, and what is wrong."""


def fault_message(error: BaseException, method: Any) -> str:
    """One line with the exception raised in a tracker's method and its place in the tracker's code.

    A UserError of uavbench's own trackers is returned unchanged.
    """
    if isinstance(error, UserError) and _top(getattr(method, "__module__", "")) in OURS:
        return one_line(str(error))
    said = str(error) if isinstance(error, ResultError | UserError) else named(error)
    return f"{one_line(said)} ({place(error, method)})"


def named(error: BaseException) -> str:
    """Name and message of any exception, even if its `__str__` raises."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception as another:
        return f"{type(error).__name__}, whose message cannot be made ({type(another).__name__})"


def users_place(error: BaseException) -> str:
    """File, line and function of the user's code that raised an error, in parentheses; "" if none did."""
    found = [(frame.f_code, line) for frame, line in walk_tb(error.__traceback__) if _is_users(frame)]
    return f" ({_short(found[-1][0])}:{found[-1][1]} in {found[-1][0].co_name})" if found else ""


def _is_users(frame: FrameType) -> bool:
    file = frame.f_code.co_filename
    return _top(frame.f_globals.get("__name__", "")) not in OURS and not file.startswith((*LIBRARIES, "<"))


def place(error: BaseException, method: Any) -> str:
    """File, line and function of the tracker's code that raised an exception, else those of the method's definition."""
    method = getattr(method, "__wrapped__", method)
    own = _top(getattr(method, "__module__", ""))
    found = [
        (frame.f_code, line)
        for frame, line in walk_tb(error.__traceback__)
        if (_top(frame.f_globals.get("__name__", "")) == own and frame.f_code.co_filename[:1] != "<")
        or _is_users(frame)
    ]
    code = getattr(method, "__code__", None)
    at, line = found[-1] if found else (code, code.co_firstlineno) if isinstance(code, CodeType) else (None, 0)
    return f"{_short(at)}:{line} in {at.co_name}" if at is not None else one_line(repr(method))


def is_ours(tracker: object) -> bool:
    """Whether a tracker is one that comes with uavbench."""
    return _top(type(tracker).__module__) in OURS


def checked(result: Any) -> TrackResult:
    """A result of `track` in plain Python numbers and a copy of its covariance, which a tracker may write to again.

    ResultError when it is invalid.
    """
    if not isinstance(result, TrackResult):
        raise ResultError(f"[no-result] track returned {_named(result)}, not a uavbench.tracker.protocol.TrackResult")
    if result.status not in STATUSES:
        raise ResultError(f"[bad-result] the status {result.status!r} is none of {', '.join(STATUSES)}")
    pose, covariance = result.cam_from_world, result.covariance
    if pose is not None and not isinstance(pose, Pose):
        raise ResultError(f"[bad-result] cam_from_world is {_named(pose)}; make it with Pose.from_matrix(...)")
    if pose is not None and not np.isfinite(pose.matrix).all():
        raise ResultError("[bad-result] the pose is not finite; a frame without a good pose has the status `lost`")
    if pose is not None and not is_rotation(pose.rotation):
        raise ResultError("[bad-result] the rotation of the pose is none: its rows are not orthonormal, or it mirrors")
    if covariance is not None and (why := _no_covariance(covariance)):
        raise ResultError(f"[bad-result] the covariance {why}")
    try:
        stage_ms = {str(name): float(ms) for name, ms in result.stage_ms.items()}
    except (AttributeError, TypeError, ValueError):
        raise ResultError("[bad-result] stage_ms is not a mapping of names to milliseconds") from None
    for name, ms in stage_ms.items():
        if not 0 <= ms < math.inf:
            raise ResultError(f"[bad-result] stage_ms of {name} is {ms}, not the milliseconds of a time")
        if not name.isprintable():
            raise ResultError(f"[bad-result] stage_ms names {name!r}; a name is one line of text")
    counts = {name: getattr(result, name) for name in COUNTS}
    for name, count in counts.items():
        if count is not None and not isinstance(count, Integral):
            raise ResultError(f"[bad-result] {name} is {_named(count)}, not an integer")
    nfa = result.log10_nfa
    if nfa is not None and (not isinstance(nfa, int | float | np.floating) or math.isnan(nfa)):
        raise ResultError(f"[bad-result] log10_nfa is {_named(nfa)}, not a number")
    whole: dict[str, Any] = {name: None if count is None else int(count) for name, count in counts.items()}
    own = None if covariance is None else read_only(covariance)
    log10_nfa = None if nfa is None else float(nfa)
    return replace(result, covariance=own, stage_ms=stage_ms, **whole, log10_nfa=log10_nfa)


def _no_covariance(covariance: Any) -> str:
    """Reason why a value is not a covariance of a pose; "" if it is one."""
    if not isinstance(covariance, np.ndarray) or covariance.shape != (6, 6):
        return f"is {_named(covariance)}, not an array (6, 6)"
    if not (issubclass(covariance.dtype.type, Real) and np.isfinite(covariance).all()):
        return "holds a number that is not finite"
    if np.abs(covariance - covariance.T).max() > ASYMMETRY * np.abs(covariance).max():
        return "is not symmetric; is it a triangular factor of one? Then return L @ L.T"
    values = np.linalg.eigvalsh(0.5 * (covariance + covariance.T))
    if not values[0] >= LEAST_EIGENVALUE * abs(values[-1]):
        return f"has the eigenvalue {values[0]:.3g}; none may be negative"
    return ""


def _named(value: Any) -> str:
    shape = f" of shape {value.shape}" if isinstance(value, np.ndarray) else ""
    return "None" if value is None else f"{type(value).__name__}{shape}"


def _top(module: str) -> str:
    return module.split(".")[0]


def _short(code: CodeType) -> str:
    """Path of a source file relative to its top package's parent, independent of the installation."""
    path = Path(code.co_filename)
    for module in list(sys.modules.values()):
        if getattr(module, "__file__", None) == code.co_filename:
            return "/".join(path.parts[-max(1, len(module.__name__.split("."))) :])
    return path.name
