"""Fonts that come with matplotlib, whatever its list of fonts names.

That list is a file in the user's cache. One that was written while an installation was being removed lacks fonts, and
matplotlib then draws other characters in their place with no more than a warning: xi as a quotation mark.
"""

from pathlib import Path

import matplotlib as mpl
from matplotlib.font_manager import fontManager

FOLDER = Path(mpl.get_data_path()) / "fonts" / "ttf"


def name_fonts() -> None:
    """Put the fonts of matplotlib's own folder that its list does not name before all others, in this process alone."""
    others = fontManager.ttflist[:]
    known = {entry.fname for entry in others}
    for path in sorted(FOLDER.glob("*.ttf")):
        if str(path) not in known:
            fontManager.addfont(path)
    fontManager.ttflist[:] = [*fontManager.ttflist[len(others) :], *others]
