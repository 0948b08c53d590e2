"""The figures of a report: title, drawing function, and whether each is drawn by default."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from uavbench.reports.page.templates import FigureOnPage, on_page
from uavbench.reports.progress import Steps

Figures = Literal["page", "all"]
"""Which figures a report draws: those of its first page, or every one."""
WEIGHT = 8
"""Cost of a figure in frames of an overlay, for the progress bar."""


@dataclass(frozen=True)
class Drawing:
    """A figure that can be drawn: file name without its suffix, title, caption, and what writes its files to a stem.

    always: it is drawn by default; late: it is drawn after the others, because its data are computed in parallel.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[Path], list[Path]]
    always: bool = True
    late: bool = False


@dataclass
class Easel:
    """Draws into `figures/` of a report's folder, and counts what it leaves out."""

    folder: Path
    figures: Figures
    steps: Steps
    left_out: int = field(default=0, init=False)

    def draw(self, drawings: Sequence[Drawing]) -> list[FigureOnPage]:
        """The figures that were drawn, in order."""
        asked = [drawing for drawing in drawings if drawing.always or self.figures == "all"]
        self.left_out += len(drawings) - len(asked)
        drawn = {}
        for drawing in sorted(asked, key=lambda each: each.late):
            files = drawing.draw(self.folder / "figures" / drawing.name)
            drawn[drawing.name] = on_page(self.folder, files, drawing.title, drawing.caption)
            self.steps(WEIGHT)
        return [drawn[drawing.name] for drawing in asked]
