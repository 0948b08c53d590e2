"""The reference from the code: `python -m uavbench.bench.reference DIR` writes commands, plug-ins and the schema.

Commands and Python names are left to mkdocs-click and mkdocstrings. Own code for the rest: neither knows the registries
from which a suite chooses by `kind`, nor the bounds in annotations.
"""

import ast
import inspect
import types
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import click

import uavbench
from uavbench.bench.config.inventory import TITLES
from uavbench.bench.config.plugins import DEFAULT_KINDS, PLUGINS
from uavbench.bench.runner.commands import schema
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.robust.config import RobustConfig
from uavbench.trajectories.files.writing import write_text

REFERENCE = "reference pages"


def commands() -> str:
    """Every command with its options, as mkdocs-click writes them."""
    return (
        "# Commands\n\n::: mkdocs-click\n    :module: uavbench.bench.cli.main\n    :command: main\n"
        "    :prog_name: uavbench\n    :depth: 1\n"
    )


def python() -> str:
    """Every public name of the package, as mkdocstrings writes it."""
    parts = ["# Python\n\n```python\nimport uavbench as ub\n```\n\n[How they are used](../api.md).\n"]
    parts += [f"::: uavbench.{name}\n" for name in uavbench.__all__ if name != "figures"]
    parts.append("## Figures\n\n::: uavbench.reports.figures_on_axes\n    options:\n      show_root_heading: false\n")
    return "\n".join(parts)


def plugins() -> str:
    """Every plug-in with its parameters, their types, ranges and defaults."""
    parts = ["# What a suite can name\n", _dataclass("A sequence", SequenceSpec)]
    for protocol, (registry, verb) in PLUGINS.items():
        title = TITLES.get(protocol.__name__, protocol.__name__)
        own = "" if protocol in DEFAULT_KINDS else f"Your own: a dataclass with a method `{verb}`.\n"
        parts.append(f"## {title.capitalize()}\n\n{own}")
        parts += [_dataclass(f"`{kind}`", cls) for kind, cls in registry.items()]
    return "\n".join(parts)


def _dataclass(title: str, cls: type) -> str:
    hints = get_type_hints(cls, include_extras=True)
    about = f"### {title}\n\n{inspect.cleandoc(cls.__doc__ or '')}\n"
    shown = [f for f in fields(cls) if f.init]  # type: ignore[arg-type, unused-ignore]
    if not shown:
        return about
    rows = [f"| `{f.name}` | {type_text(hints[f.name])} | {_default(f)} |" for f in shown]
    return "\n".join([about, "| key | value | default |", "|---|---|---|", *rows, ""])


def config_values() -> str:
    """Every tuned value of `robust`: its key below `config`, type, range, default, and where it comes from."""
    about = (
        "# The values of robust\n\nKeys of `[trackers.LABEL.config]` in a suite, for a tracker of kind `robust`. "
        '"Chosen on rendered seeds": by hand on seeds 100 to 107, and no better source is known.\n'
    )
    return "\n".join([about, *_tables("config", RobustConfig)])


def _tables(key: str, cls: type) -> Iterator[str]:
    """A table of the values of a config class, and those of the classes in it."""
    hints, why = get_type_hints(cls, include_extras=True), field_docs(cls)
    inner = {f.name: hints[f.name] for f in fields(cls) if is_dataclass(hints[f.name])}  # type: ignore[arg-type, unused-ignore]
    rows = [
        f"| `{f.name}` | {type_text(hints[f.name])} | {_default(f)} | {why[f.name]} |"
        for f in fields(cls)  # type: ignore[arg-type, unused-ignore]
        if f.name not in inner
    ]
    if rows:
        head = ["| key | value | default | what, and where from |", "|---|---|---|---|"]
        yield "\n".join([f"## {key}\n\n{inspect.cleandoc(cls.__doc__ or '')}\n", *head, *rows, ""])
    for name, below in inner.items():
        yield from _tables(f"{key}.{name}", below)


def field_docs(cls: type) -> dict[str, str]:
    """The text below each field of a class, on one line; KeyError where one has none."""
    (body,) = [node.body for node in ast.parse(inspect.getsource(cls)).body if isinstance(node, ast.ClassDef)]
    return {
        field.target.id: " ".join(text.value.value.split())
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


def type_text(hint: Any) -> str:
    """A type with its range, in words."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        bounds = [f"{sign} {bound}" for limit in arguments[1:] for sign, bound in _bounds(limit)]
        return " ".join([type_text(arguments[0]), " and ".join(bounds)]).strip()
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in arguments)
    if origin in (Union, types.UnionType):
        return " or ".join(type_text(a) for a in arguments if a is not type(None))
    if origin is tuple:
        return (
            f"list of {type_text(arguments[0])}"
            if Ellipsis in arguments
            else f"{len(arguments)} of {type_text(arguments[0])}"
        )
    if hint in PLUGINS:
        return f"one of the {TITLES.get(hint.__name__, hint.__name__)}"
    if isinstance(hint, type) and is_dataclass(hint):
        return "table: " + ", ".join(f"`{f.name}`" for f in fields(hint) if f.init)
    return {float: "number", int: "integer", str: "text", bool: "true or false"}.get(hint, str(hint))


def _bounds(limit: Any) -> Iterator[tuple[str, Any]]:
    """Bounds of an annotated_types limit as sign and number."""
    for name, sign in (
        ("gt", ">"),
        ("ge", "at least"),
        ("lt", "<"),
        ("le", "at most"),
        ("min_length", "length at least"),
    ):
        bound = getattr(limit, name, None)
        if (bound is not None and bound != 0) or (bound == 0 and name != "min_length"):
            yield sign, bound


def _default(field: "Field[Any]") -> str:
    if field.default is MISSING and field.default_factory is MISSING:
        return "must be given"
    if field.default is MISSING or is_dataclass(field.default):
        return "its own defaults"
    return f"`{field.default!r}`"


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def main(folder: Path) -> None:
    """Write the reference into FOLDER."""
    write_text(folder / "commands.md", commands(), kind=REFERENCE)
    write_text(folder / "python.md", python(), kind=REFERENCE)
    write_text(folder / "plugins.md", plugins(), kind=REFERENCE)
    write_text(folder / "robust-values.md", config_values(), kind=REFERENCE)
    write_text(folder / "suite.schema.json", schema() + "\n", kind=REFERENCE)


if __name__ == "__main__":
    main()
