"""Every tuned value of `robust`, nested by stage, with its unit, bounds and source.

In: a suite's table, or nothing. Out: a frozen `RobustConfig`. Imports no other package of the tracker; all of
them import it.
"""

from uavbench.tracker.robust.config.robust import RobustConfig

__all__ = ["RobustConfig"]
