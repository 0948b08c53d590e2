"""The pages of the docs and their code blocks."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))
GENERATED = {
    "gallery.md",
    *(
        f"reference/{name}"
        for name in ("commands.md", "plugins.md", "python.md", "robust-values.md", "suite.schema.json")
    ),
    *(f"tutorials/{path.stem}.md" for path in sorted((ROOT / "examples").glob("*.ipynb"))),
}
"""Pages that `.ci/site` writes beside those of docs/."""
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the file it is to be saved as, its text."""

    language: str
    file: str
    text: str


def blocks(page):
    return [Block(*match.groups(default="")) for match in BLOCK.finditer(page.read_text(encoding="utf-8"))]
