"""Summary statistics of a set of errors."""

from dataclasses import asdict, dataclass

import numpy as np

from uavbench.reports.json_values import json_values
from uavbench.trajectories.pose import Array


@dataclass(frozen=True, kw_only=True)
class ErrorSummary:
    """rmse, mean, median, standard deviation (ddof 0), extremes, sum of squares and count of errors.

    All but n are NaN where there is no error to summarize, and where one of the errors is NaN.
    """

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    sse: float
    n: int

    @classmethod
    def of(cls, errors: Array) -> "ErrorSummary":
        """Summary of errors (n,)."""
        if not len(errors):
            nan = float("nan")
            return cls(rmse=nan, mean=nan, median=nan, std=nan, min=nan, max=nan, sse=nan, n=0)
        sse = float(errors @ errors)
        return cls(
            rmse=float(np.sqrt(sse / len(errors))),
            mean=float(errors.mean()),
            median=float(np.median(errors)),
            std=float(errors.std()),
            min=float(errors.min()),
            max=float(errors.max()),
            sse=sse,
            n=len(errors),
        )

    def to_json(self) -> dict[str, float | int | None]:
        """JSON object; NaN becomes null."""
        return json_values(asdict(self))

    @classmethod
    def from_json(cls, values: dict[str, float | int | None]) -> "ErrorSummary":
        """The summary that `to_json` returned as a JSON object."""
        numbers = {k: float("nan") if v is None else float(v) for k, v in values.items() if k != "n"}
        return cls(**numbers, n=int(values["n"] or 0))
