"""The gate's findings as text, JUnit XML, JSON and Markdown."""

import fcntl
import json
import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from uavbench.bench.gate.decision import Finding, Margins, gate, is_share, overall
from uavbench.bench.gate.paired_scores import COVERAGE, SUCCESS
from uavbench.bench.gate.worst_pictures import write_worst
from uavbench.bench.runner.output_folder import VERDICT, VERDICT_FILES, note_verdict, noted_verdicts
from uavbench.bench.said import say
from uavbench.reports.json_values import json_values
from uavbench.trajectories.errors import DiskError
from uavbench.trajectories.files.origin import refuse_no_folder
from uavbench.trajectories.files.writing import write_text

HEADER = ["tracker", "metric", "baseline", "value", "change", "95 % bounds", "margin", "verdict", "why"]


FOOT = (
    "baseline and value: means over sequences of means over seeds. Of errors and latency they are geometric: change = "
    "value / baseline - 1. Of coverage and success they are arithmetic: change = value - baseline. A typical change "
    "clips each run's ratio; baseline and value are not defined for it."
)
ENOUGH_SEQUENCES = 5
"""Sequences from which a bootstrap of them is about as wide as it says: see docs/gate.md."""
EXIT_CODES = {"pass": 0, "fail": 1, "inconclusive": 3}


def pronounce(results: Path, baseline: Path, margins: Margins, out: Path) -> int:
    """Print and write the findings of the gate, with pictures of the worst sequences; its exit code.

    UserError before anything is written when a note of earlier verdicts was damaged, so that no verdict goes unnoted.
    """
    for folder in (results, baseline):
        noted_verdicts(folder)
    findings = gate(results, baseline, margins)
    with _alone_in(out):
        write_reports(findings, margins, out, write_worst(results, baseline, margins, out))
        for folder in (results, baseline):
            note_verdict(folder, out)
    say(to_text(findings))
    return EXIT_CODES[overall(findings)]


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Context in which no other gate writes into a folder, so that its files are of one verdict: that of the last."""
    refuse_no_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise DiskError.of(error, f"{folder}: cannot be written: {error.strerror}; name another folder") from None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def write_reports(findings: list[Finding], margins: Margins, folder: Path, worst: str = "") -> None:
    """Write gate.json, gate.xml (JUnit) and gate.md, at its end the worst sequences."""
    summary = "\n".join(part for part in (to_markdown(findings), worst) if part)
    for name, text in zip(VERDICT_FILES, (to_json(findings, margins), to_junit(findings), summary), strict=True):
        write_text(folder / name, text, kind=VERDICT)


def cells(finding: Finding) -> list[str]:
    """A finding as the cells of a table, in the order of HEADER."""
    unit = f" {finding.unit}" if finding.unit else ""
    sign = -1 if finding.metric in (COVERAGE, SUCCESS) else 1  # a loss is negative in the table
    low, high = sorted((sign * finding.low, sign * finding.high))
    bounds = "-" if math.isnan(finding.low) else f"{percent(low)} .. {percent(high)}"
    numbers = [f"{v:#.5g}{unit}" if math.isfinite(v) else "-" for v in (finding.baseline, finding.value)]
    change, margin = percent(sign * finding.change), percent(sign * finding.margin)
    return [finding.run, finding.metric, *numbers, change, bounds, margin, finding.verdict, _plain(finding.reason)]


def percent(share: float) -> str:
    """A share in percent with its sign: two decimals, or two significant digits below; `0%` for no change."""
    value = 100 * share
    if not math.isfinite(value):
        return "-"
    if abs(value) < NOTHING_PERCENT:
        return "0%"
    decimals = max(2, 1 - math.floor(math.log10(abs(value))))
    return f"{value:+.{decimals}f}%"


NOTHING_PERCENT = 1e-6
"""Change in percent below which it counts as round-off."""


def to_text(findings: list[Finding]) -> str:
    """Aligned table with the overall verdict under it."""
    rows = [HEADER, *map(cells, findings)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADER))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, "", FOOT, *notes(findings), f"gate: {overall(findings)}"])


def repeated(findings: list[Finding]) -> list[str]:
    """A line for each tracker and rate with seeds that count once."""
    return list(dict.fromkeys(f"{f.run}: {_plain(f.repeats)}" for f in findings if f.repeats))


def too_narrow(findings: list[Finding]) -> list[str]:
    """A line where bounds of errors or latency are those of a bootstrap of few sequences."""
    few = {
        f.sequences for f in findings if not is_share(f) and math.isfinite(f.low) and 1 < f.sequences < ENOUGH_SEQUENCES
    }
    return [
        f"over {n} sequences, which tell little of how much sequences differ, the bounds of errors and latency are too "
        f"narrow, and more fail by chance than the gate allows: give the suite {ENOUGH_SEQUENCES} or more"
        for n in sorted(few)
    ]


def notes(findings: list[Finding]) -> list[str]:
    """What to know of the findings, below their table."""
    return [*too_narrow(findings), *repeated(findings)]


def to_markdown(findings: list[Finding]) -> str:
    """Table for a pull request's summary."""
    rows = [HEADER, ["---"] * len(HEADER), *([c.replace("|", "\\|") for c in cells(f)] for f in findings)]
    table = "\n".join("| " + " | ".join(row) + " |" for row in rows)
    foot = "\n\n".join([FOOT, *notes(findings)])
    return f"## uavbench gate: {overall(findings)}\n\n{table}\n\n{foot}\n"


def to_json(findings: list[Finding], margins: Margins) -> str:
    """JSON object; NaN becomes null."""
    rows = [json_values(asdict(finding)) for finding in findings]
    about = {"verdict": overall(findings), "means": FOOT, "margins": asdict(margins), "findings": rows}
    return json.dumps(about, indent=1, allow_nan=False) + "\n"


def to_junit(findings: list[Finding]) -> str:
    """JUnit XML: a test case for each finding; inconclusive is `skipped`."""
    counts = {v: str(sum(f.verdict == v for f in findings)) for v in ("fail", "inconclusive")}
    attributes = {"tests": str(len(findings)), "failures": counts["fail"], "skipped": counts["inconclusive"]}
    suites = ET.Element("testsuites", {"name": "uavbench gate", **attributes})
    suite = ET.SubElement(suites, "testsuite", {"name": "uavbench gate", "errors": "0", **attributes})
    for finding in findings:
        case = ET.SubElement(suite, "testcase", {"classname": finding.run, "name": finding.metric})
        line = "; ".join(f"{name}: {cell}" for name, cell in zip(HEADER[2:], cells(finding)[2:], strict=True) if cell)
        if finding.verdict == "fail":
            ET.SubElement(case, "failure", {"message": _plain(finding.reason)}).text = line
        elif finding.verdict == "inconclusive":
            ET.SubElement(case, "skipped", {"message": _plain(finding.reason)})
        ET.SubElement(case, "system-out").text = "\n".join([line, *notes([finding])])
    ET.indent(suites)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(suites, encoding="unicode") + "\n"


def _plain(text: str) -> str:
    """Text without the control characters that neither XML nor a terminal should get."""
    return "".join(c if c.isprintable() else " " for c in text)
