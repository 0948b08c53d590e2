"""The latest commit of a history in the formats of github-action-benchmark and Bencher."""

from typing import Any

from uavbench.reports.history.series import Series


def github_benchmark(found: list[Series], *, bigger: bool) -> list[dict[str, Any]]:
    """Input of github-action-benchmark, customBiggerIsBetter or customSmallerIsBetter: the series of that kind."""
    return [
        {
            "name": series.name,
            "unit": series.unit or "share",
            "value": float(series.value[-1]),
            **({"range": f"{low:.6g} .. {high:.6g}"} if (low := series.low[-1]) <= (high := series.high[-1]) else {}),
            "extra": f"{series.commits[-1].commit}\n{series.commits[-1].subject}",
        }
        for series in found
        if series.bigger == bigger
    ]


def bencher(found: list[Series]) -> dict[str, dict[str, dict[str, float]]]:
    """Bencher Metric Format: a benchmark per tracker, a measure per metric, with its unit in the name."""
    benchmarks: dict[str, dict[str, dict[str, float]]] = {}
    for series in found:
        metric = {"value": float(series.value[-1])}
        if series.low[-1] <= series.high[-1]:
            metric |= {"lower_value": float(series.low[-1]), "upper_value": float(series.high[-1])}
        measure = f"{series.metric} ({series.unit})" if series.unit else series.metric
        benchmarks.setdefault(series.tracker, {})[measure] = metric
    return benchmarks
