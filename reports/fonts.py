"""Fonts that come with matplotlib, whatever its list of fonts names.

That list is a file in the user's cache. One that was written while an installation was being removed lacks fonts, and
matplotlib then draws other characters in their place with no more than a warning: xi as a quotation mark.
"""

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import matplotlib as mpl
from matplotlib.font_manager import fontManager, get_font

FOLDER = Path(mpl.get_data_path()) / "fonts" / "ttf"
FAMILIES = {"STIXGeneral": "STIXGeneral.ttf", "DejaVu Sans": "DejaVuSans.ttf"}
"""Families of figures and their files: a glyph is of the first one that has it."""


def name_fonts() -> None:
    """Put the fonts of matplotlib's own folder that its list does not name before all others, in this process alone."""
    others = fontManager.ttflist[:]
    known = {entry.fname for entry in others}
    for path in sorted(FOLDER.glob("*.ttf")):
        if str(path) not in known:
            fontManager.addfont(path)
    fontManager.ttflist[:] = [*fontManager.ttflist[len(others) :], *others]


def undrawable(text: str) -> str:
    """The characters of a text that no font of the figures has, each once."""
    return "".join(dict.fromkeys(c for c in text if c not in _drawn()))


def note_on_glyphs(names: Iterable[str]) -> str:
    """A sentence about names that the figures cannot show; "" without any."""
    lacking = {name: missing for name in names if (missing := undrawable(name))}
    if not lacking:
        return ""
    what = ", ".join(f"{missing} of {name}" for name, missing in lacking.items())
    return f"figures show boxes in place of what their fonts lack ({what}): give names in letters that they have"


@lru_cache(maxsize=1)
def _drawn() -> frozenset[str]:
    return frozenset(chr(code) for name in FAMILIES.values() for code in get_font(FOLDER / name).get_charmap())
