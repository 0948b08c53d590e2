"""`robust`: model edges and texture patches in one fit, with learned biases, track loss and relocalization.

In: an image and its stamp. Out: a pose with covariance, or `lost`. Imports the tracker protocol and geometry kernels;
nothing of `shang_shen`. `Robust` is imported lazily, so that importing one kernel does not load the whole package.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uavbench.tracker.robust.tracker import Robust

__all__ = ["Robust"]


def __getattr__(name: str) -> Any:
    if name != "Robust":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from uavbench.tracker.robust.tracker import Robust

    return Robust
