"""Every tuned value of `robust`, nested by stage, with its unit, bounds and where it comes from.

In: a suite's table, or nothing. Out: a frozen `RobustConfig`. Imports nothing of the tracker's other rooms, which all
import it.
"""

from uavbench.tracker.robust.config.robust import RobustConfig

__all__ = ["RobustConfig"]
