"""The columns of tables: the number of a score that each shows, its unit and format."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from uavbench.reports.statistics.bootstrap import Interval
from uavbench.trajectories.pose import Array

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of the summary.

    It shows `scale` times the column `key` of the DataFrame of scores, in `unit`; where that is NaN, the column
    `otherwise`. best: `min`, `max`, or "" for none; short: the head in LaTeX, "" for `head`. No value is below 0, none
    in % above 100, and none above `most`.
    """

    head: str
    key: str
    unit: str
    best: str
    decimals: int
    short: str = ""
    scale: float = 1.0
    otherwise: str = ""
    most: float = float("inf")

    def within(self, interval: Interval) -> Interval:
        """The interval without what no mean of the column can be."""
        low, high = np.clip([interval.low, interval.high], 0.0, min(self.most, 100.0 if self.unit == "%" else np.inf))
        return replace(interval, low=float(low), high=float(high))

    def of(self, rows: "DataFrame") -> Array:
        """Values (n,) of these rows of a DataFrame of scores, in the column's unit; NaN where there is none."""
        known = [rows[key] for key in (self.key, self.otherwise) if key in rows]
        values = known[0].fillna(known[1]) if len(known) > 1 else known[0] if known else np.full(len(rows), np.nan)
        return self.scale * np.asarray(values, dtype=np.float64)


COLUMNS: tuple[Column, ...] = (
    Column(head="coverage", key="tracking_coverage", scale=100, unit="%", best="max", decimals=1),
    Column(
        head="within 5 cm, 5 deg", key="tracking_success", scale=100, unit="%", best="max", decimals=1, short="success"
    ),
    Column(head="AUC 10 cm", key="tracking_success_auc", unit="", best="max", decimals=2, short="AUC", most=1.0),
    Column(
        head="ATE position",
        key="ate_none_translation_rmse_m",
        scale=100,
        unit="cm",
        best="min",
        decimals=2,
        short="ATE pos.",
    ),
    Column(head="ATE rotation", key="ate_none_rotation_rmse_deg", unit="deg", best="min", decimals=2, short="ATE rot."),
    Column(
        head="RPE 1 frame",
        key="rpe_1frame_translation_rmse_m",
        scale=100,
        unit="cm",
        best="min",
        decimals=2,
        short="RPE frame",
    ),
    Column(head="RPE 1 s", key="rpe_1s_translation_rmse_m", scale=100, unit="cm", best="min", decimals=2),
    Column(head="edges", key="model_edges_mean_px", unit="px", best="min", decimals=1),
    Column(head="failures", key="tracking_failures_per_minute", unit="1/min", best="min", decimals=1),
    Column(
        head="first failure",
        key="tracking_time_to_first_loss_s",
        otherwise="tracking_duration_s",
        unit="s",
        best="max",
        decimals=1,
        short="first fail.",
    ),
    Column(head="frame p50", key="latency_total_p50_ms", unit="ms", best="min", decimals=1),
    Column(head="frame p95", key="latency_total_p95_ms", unit="ms", best="min", decimals=1),
)
DETAILS: tuple[Column, ...] = (
    Column(head="ADD", key="model_add_mean_m", scale=100, unit="cm", best="min", decimals=2),
    Column(head="MSSD", key="model_mssd_mean_m", scale=100, unit="cm", best="min", decimals=2),
    Column(head="MSPD", key="model_mspd_mean_px", unit="px", best="min", decimals=1),
    Column(head="recovery", key="tracking_time_to_recover_s", unit="s", best="min", decimals=2),
    Column(
        head="longest failure",
        key="tracking_longest_failure_s",
        unit="s",
        best="min",
        decimals=2,
        short="longest fail.",
    ),
    Column(head="NEES", key="consistency_mean", unit="expected 6", best="", decimals=1),
    Column(
        head="claimed sigma",
        key="consistency_sharpness_m",
        scale=100,
        unit="cm",
        best="",
        decimals=2,
        short="claimed std.",
    ),
    Column(head="error / CRLB", key="bound_median", unit="median", best="min", decimals=1, short="err./CRLB"),
    Column(head="frame p99", key="latency_total_p99_ms", unit="ms", best="min", decimals=1),
    Column(head="frame max", key="latency_total_max_ms", unit="ms", best="min", decimals=1),
    Column(head="deadline misses", key="deadline_misses", scale=100, unit="%", best="min", decimals=1, short="misses"),
    Column(
        head="in real time: within 5 cm, 5 deg",
        key="replay_success",
        scale=100,
        unit="%",
        best="max",
        decimals=1,
        short="live success",
    ),
    Column(
        head="in real time: frames missed",
        key="replay_dropped",
        scale=100,
        unit="%",
        best="min",
        decimals=1,
        short="live missed",
    ),
    Column(
        head="in real time: age of the pose", key="replay_age_ms", unit="ms", best="min", decimals=0, short="live age"
    ),
)
TWO_COLUMNS = ("coverage", "within 5 cm, 5 deg", "ATE position", "ATE rotation", "RPE 1 s", "failures", "frame p95")
"""Columns of a table over both columns of a page, and of the first table of the HTML page."""
ONE_COLUMN = ("within 5 cm, 5 deg", "ATE position", "ATE rotation", "frame p95")
"""Columns of a table in one column of a page."""
