"""Colours of PLY files: red, green and blue as bytes, or as parts of 1; others would be white, wrapped or left out."""

from pathlib import Path
from typing import Any

import numpy as np

from uavbench.trajectories.errors import UserError

NAMES = ("red", "green", "blue")
OTHER_NAMES = (NAMES, ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
"""Names of the colours in files of some programs, in small letters."""
WHITE = 255
ROUND_OFF = 0.01
"""How far parts of 1 may be beyond 0 and 1: exporters' round-off."""


def check_ply_colours(path: Path, mesh: Any) -> None:
    """UserError for colours of the mesh of a PLY file, as trimesh has read it, that have other names or ranges."""
    elements = mesh.metadata.get("_ply_raw") or {}
    for element in ("vertex", "face"):
        columns = _columns(elements.get(element, {}).get("data"))
        if why := _misnamed(list(columns)) or _out_of_range([columns[name] for name in NAMES if name in columns]):
            raise UserError(f"{path}: the colours of its {element} element {why}")


def _columns(data: Any) -> dict[str, Any]:
    """Values of an element by the names of its properties; none where it has no names."""
    names = tuple(data) if isinstance(data, dict) else getattr(getattr(data, "dtype", None), "names", None) or ()
    return {name: data[name] for name in names}


def _misnamed(names: list[str]) -> str:
    """What is wrong with the names of an element's properties, "" if nothing."""
    if set(NAMES) <= set(names):
        return ""
    small = {name.lower(): name for name in names}
    for others in OTHER_NAMES:
        if set(others) <= set(small):
            found = ", ".join(small[name] for name in others)
            return f"are named {found}; name them {', '.join(NAMES)} in its header, or export it again"
    return ""


def _out_of_range(colours: list[Any]) -> str:
    """What is wrong with the values of an element's colours, "" if nothing."""
    if len(colours) < len(NAMES) or not all(len(values) for values in colours):
        return ""
    values = np.stack([np.asarray(values, dtype=np.float64).ravel() for values in colours])
    if not np.isfinite(values).all():
        return "are not all finite numbers; export the model again"
    whole = all(np.issubdtype(np.asarray(column).dtype, np.integer) for column in colours)
    low, high = (0.0, float(WHITE)) if whole else (-ROUND_OFF, 1 + ROUND_OFF)
    if low <= values.min() and values.max() <= high:
        return ""
    kind = f"integers beyond 0 to {WHITE}" if whole else "floats beyond 0 to 1"
    return f"are {kind} ({values.min():g} to {values.max():g}); export them as uchar, 0 to {WHITE}"
