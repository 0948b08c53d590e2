"""For the site: each block of a page that is fenced as `math` is drawn into the page, without scripts or fonts."""

import re
from html import escape
from typing import Any

from matplotlib import rc_context
from matplotlib.path import Path
from matplotlib.textpath import TextPath

from uavbench.reports.fonts import name_fonts

EQUATION = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)
SIZE_PX = 20
"""Of the text, in px of the page at its usual size."""
MARGIN_PX = 2
COMMANDS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C", Path.CLOSEPOLY: "Z"}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page with its equations drawn; mkdocs calls this hook."""
    return EQUATION.sub(lambda found: drawn(found[1]), markdown)


def drawn(tex: str) -> str:
    """An equation as SVG in the colour of the text, its TeX as label; ValueError where matplotlib cannot set it."""
    name_fonts()
    with rc_context({"mathtext.fontset": "cm"}):
        outline = TextPath((0, 0), f"${' '.join(tex.split())}$", size=SIZE_PX)
    (left, bottom), (right, top) = outline.get_extents().padded(MARGIN_PX).get_points()
    steps = [
        COMMANDS[code] + " ".join(f"{v:.2f}" for v in ([] if code == Path.CLOSEPOLY else points))
        for points, code in outline.iter_segments(simplify=False)
    ]
    width, height = right - left, top - bottom
    return (
        f'<div class="equation" role="img" aria-label="{escape(tex)}"><svg xmlns="http://www.w3.org/2000/svg"'
        f' width="{width:.0f}" height="{height:.0f}" viewBox="{left:.2f} {-top:.2f} {width:.2f} {height:.2f}">'
        f'<path transform="scale(1 -1)" d="{"".join(steps)}"/></svg></div>'
    )
