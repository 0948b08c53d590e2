"""Types of arguments and options: paths and texts, of which an empty one is a variable of a script that is not set."""

import os
from pathlib import Path
from typing import Any

import click

EMPTY = "is empty; is a variable of a script not set?"


class FilePath(click.Path):
    """A path; an empty one, which would be the current folder, is refused, and one in a folder called `~`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path of an argument."""
        if value == "":
            self.fail(EMPTY, param, ctx)
        if isinstance(value, str) and (home := os.path.expanduser(value)) != value:  # noqa: PTH111, raises nothing
            self.fail(
                f"{value}: the shell put no home in place of ~, as after = or in quotes; write {home}", param, ctx
            )
        return super().convert(value, param, ctx)


FILE = FilePath(path_type=Path)


def filled(ctx: click.Context, parameter: click.Parameter, text: str | None) -> str:
    """Callback of an option of which an empty text would mean that it was not given, as it is by default."""
    if text == "":
        raise click.BadParameter(EMPTY)
    return text or ""
