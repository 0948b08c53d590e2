"""Bounds and units of the values in `RobustConfig`, as annotated types that are validated when a suite is read.

The unit is part of a value's name; values without a unit, or with two units, have a type that says so.
"""

from typing import Annotated

from annotated_types import Ge, Gt, Interval, Unit

Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Part = Annotated[float, Interval(ge=0, le=1), Unit("1")]
"""A fraction, from 0 to 1."""
Ratio = Annotated[float, Gt(0), Unit("1")]
"""A ratio, which may exceed one."""
Weight = Annotated[float, Ge(0), Unit("1")]
"""A factor, which may be zero."""
Sigma = Annotated[float, Gt(0), Unit("part of the range; rad")]
"""Standard deviation of a pose: of its position as a fraction of the range, of its rotation in rad."""
Count = Annotated[int, Ge(1), Unit("1")]
