"""Bounds and units of the values in `RobustConfig`, as annotated types that the suites' reader checks.

A value with a dimension names its unit in its name; one without, or with two, is of a type that says so.
"""

from typing import Annotated

from annotated_types import Ge, Gt, Interval, Unit

Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Part = Annotated[float, Interval(ge=0, le=1), Unit("1")]
"""A part of a whole."""
Ratio = Annotated[float, Gt(0), Unit("1")]
"""A ratio, which may exceed one."""
Weight = Annotated[float, Ge(0), Unit("1")]
"""A factor, which may be zero."""
Sigma = Annotated[float, Gt(0), Unit("part of the range; rad")]
"""One standard deviation of a pose: of its position in parts of the range, of its rotation in rad."""
Count = Annotated[int, Ge(1), Unit("1")]
Number = Annotated[int, Ge(0), Unit("1")]
"""A number of things, or none."""
