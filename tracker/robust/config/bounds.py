"""Bounds of the values in `RobustConfig`, as annotated types that the suites' reader checks."""

from typing import Annotated

from annotated_types import Ge, Gt, Interval

Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Part = Annotated[float, Interval(ge=0, le=1)]
"""A part of a whole."""
Count = Annotated[int, Ge(1)]
