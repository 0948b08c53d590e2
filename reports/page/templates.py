"""Templates of the pages, files embedded in them, and figures shown on them."""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from uavbench.reports.style import PNG_DPI, TWO_COLUMNS_IN
from uavbench.trajectories.errors import plain

HERE = Path(__file__).parent


@dataclass(frozen=True)
class FigureOnPage:
    """A figure's files relative to the report's folder, with title and caption; up: path prefix to that folder."""

    files: tuple[str, ...]
    title: str
    caption: str
    up: str = ""

    @property
    def png(self) -> str:
        """The PNG file, which the page shows."""
        return next(f for f in self.files if f.endswith(".png"))

    @property
    def id(self) -> str:
        """Anchor on the page."""
        return Path(self.png).stem

    def sized(self, folder: Path) -> dict[str, Any]:
        """Arguments of the template for a report in `folder`; width and height in CSS px."""
        with Image.open(folder / self.png) as picture:
            width, height = picture.size
        wide = width > 0.75 * TWO_COLUMNS_IN * PNG_DPI
        return {
            "files": self.files, "title": self.title, "caption": self.caption, "up": self.up, "png": self.png,
            "id": self.id, "wide": wide, "width": round(width * 96 / PNG_DPI), "height": round(height * 96 / PNG_DPI),
        }  # fmt: skip


def on_page(folder: Path, files: ListOf[Path], title: str, caption: str) -> FigureOnPage:
    """A figure with its files relative to the report in `folder`."""
    return FigureOnPage(tuple(path.relative_to(folder).as_posix() for path in files), title, caption)


def environment() -> Environment:
    """Jinja environment of the templates: autoescape, visible control characters, and no undefined variables."""
    return Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=False, finalize=_visible
    )


def _visible(value: Any) -> str:
    """A value as text, its control characters escaped."""
    return Markup(plain(value)) if isinstance(value, Markup) else plain(str(value))


def asset(name: str) -> Markup:
    """Content of a CSS or JavaScript file, to be embedded in a page."""
    return Markup((HERE / name).read_text(encoding="utf-8"))
