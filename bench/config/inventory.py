"""Every plug-in that a suite can name: `uavbench list`.

Plug-ins are parsed from the literal dicts of the registries: importing them would load the renderer, the flight
simulator and the trackers to print a page.
"""

import ast
import textwrap
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from uavbench.bench.config.suite_files import suite_names, suite_title

ROOT = Path(__file__).parents[3]
TITLES = {
    "StructureSpec": "structures",
    "EnvironmentSpec": "environments",
    "ClutterSpec": "clutter",
    "EffectSpec": "effects",
    "PathSpec": "paths",
    "AirframeSpec": "airframes",
    "WindSpec": "winds",
    "SensorSpec": "body sensors",
    "MountSpec": "camera mounts",
    "Initialization": "initial poses",
    "RecordingSource": "recordings",
    "Tracker": "trackers",
    "LatencySpec": "latencies in flight",
}


def inventory() -> str:
    """Text list of suites and plug-ins by kind, each with the first sentence of its docstring."""
    lines = ["suites"]
    for name in suite_names():
        lines.append(f"  {name:<22} {suite_title(name)}")
    for protocol, plugins in registered().items():
        lines.append(f"\n{TITLES.get(protocol, protocol)}")
        for kind, words in plugins.items():
            about = textwrap.shorten(words.split("\n\n")[0], 90, placeholder=" ...")
            lines.append(f"  {kind:<22} {about}")
    return "\n".join(lines)


def registered() -> dict[str, dict[str, str]]:
    """Name of each plug-in point -> name of each of its plug-ins -> docstring."""
    module = ModuleSource.of("uavbench.bench.config.plugins")
    points = module.value("PLUGINS")
    assert isinstance(points, ast.Dict)
    found = {}
    for protocol, entry in zip(points.keys, points.values, strict=True):
        assert isinstance(protocol, ast.Name) and isinstance(entry, ast.Tuple)
        found[protocol.id] = dict(module.plugins(entry.elts[0]))
    return found


class ModuleSource:
    """The syntax tree of a module of uavbench."""

    def __init__(self, name: str) -> None:
        body = ast.parse(ROOT.joinpath(*name.split(".")).with_suffix(".py").read_text(encoding="utf-8")).body
        self.classes = {node.name: node for node in body if isinstance(node, ast.ClassDef)}
        self.values = {
            node.target.id: node.value
            for node in body
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
        }
        self.imported = {
            alias.asname or alias.name: (str(node.module), alias.name)
            for node in body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }

    @staticmethod
    @cache
    def of(name: str) -> "ModuleSource":
        """The source of the module of this name."""
        return ModuleSource(name)

    def value(self, name: str) -> ast.expr | None:
        """The value assigned to `NAME: type =` in this module."""
        return self.values[name]

    def plugins(self, node: ast.expr | None) -> Iterator[tuple[str, str]]:
        """Name and docstring of each plug-in of a dict display, or of a dict given by its name."""
        if isinstance(node, ast.Name):
            if node.id in self.imported:
                module, name = self.imported[node.id]
                yield from ModuleSource.of(module).plugins(ast.Name(name))
            else:
                yield from self.plugins(self.value(node.id))
            return
        assert isinstance(node, ast.Dict)
        for kind, entry in zip(node.keys, node.values, strict=True):
            if kind is None:  # **another
                yield from self.plugins(entry)
            else:
                assert isinstance(kind, ast.Constant) and isinstance(entry, ast.Name)
                yield str(kind.value), self.docstring(entry.id)

    def docstring(self, name: str) -> str:
        """Docstring of a class, which is given by its name in this module."""
        if name in self.imported:
            module, name = self.imported[name]
            return ModuleSource.of(module).docstring(name)
        return ast.get_docstring(self.classes[name]) or ""
