"""The file of a camera, `camera.toml`: its values by key, and what to do about a file that is none."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from uavbench.scenes.calibrations.other_tools import advice_on
from uavbench.trajectories.errors import DamagedFileError, UserError
from uavbench.trajectories.files.limits import SETTINGS
from uavbench.trajectories.files.reading import opened, read_json, read_toml
from uavbench.trajectories.files.writing import write_text

SEQUENCE = "sequence.json"
"""File of a sequence beside the `camera.toml` of its main camera; those of others are in `cameras/NAME/`."""
REQUIRED = ("width", "height", "fx", "fy", "cx", "cy")
"""Keys that every file has; the others have defaults."""
HEAD_BYTES = 1 << 16
"""Bytes of a file that tell which tool wrote it."""


def write_camera_file(path: Path, values: Mapping[str, Any], *, kind: str = "") -> None:
    """Write the fields of a camera, by name; kind: see `new_file`."""
    model, response = values["distortion_model"], values["response"]
    lines = [f"{key} = {values[key]!r}" for key in REQUIRED]
    lines += [f'distortion_model = "{model}"', f"distortion = {list(values['distortion'])!r}"]
    lines += [f"bits = {values['bits']}"] if values["bits"] else []
    named = isinstance(response, str)
    if response != "srgb":
        lines.append(f'response = "{response}"' if named else f"response = {float(response)}")
    lines += [f"readout_ms = {values['readout_ms']}"] if values["readout_ms"] else []
    if values["masked"]:
        lines.append(f"masked = {[[list(corner) for corner in polygon] for polygon in values['masked']]}")
    write_text(path, "\n".join(lines) + "\n", kind=kind)


def read_camera_file(path: Path, fields: Sequence[str], inside: Path | None = None) -> dict[str, Any]:
    """Values of a camera's fields in a file, which must lie in the folder `inside` if given.

    UserError for keys that are not among the fields or are missing, and for a file of another tool what to do about it.
    """
    try:
        values = read_toml(path, inside=inside, hint=" (camera.toml holds width, height, fx, fy, cx, cy)")
    except UserError:
        if advice := _other_tool(path, inside):
            raise UserError(f"{path}: {advice}") from None
        raise
    unknown = sorted(set(values) - set(fields))
    missing = [key for key in REQUIRED if key not in values]
    if unknown or missing:
        raise UserError(f"{path}: unknown keys {unknown}, missing keys {missing} (a camera has {', '.join(fields)})")
    return values


def told_beside(path: Path) -> tuple[Path, ...]:
    """File beside a `camera.toml` that tells of its rolling shutter: the `sequence.json` of a rendered sequence."""
    file = next((place for place in _sequences(path) if place.is_file()), None)
    return (file,) if file is not None and row_delay_ns(path) else ()


def row_delay_ns(path: Path) -> float:
    """Time in ns between two rows of the camera of a rendered sequence, by its `camera.toml`; 0 for any other file."""
    file = next((place for place in _sequences(path) if place.is_file()), None)
    if file is None:
        return 0.0
    try:
        about = read_json(file)
    except DamagedFileError:
        raise
    except UserError:  # of another tool
        return 0.0
    others = about.get("cameras")
    if file.parent != path.absolute().parent:
        of_camera = others.get(path.absolute().parent.name) if isinstance(others, dict) else None
        about = of_camera if isinstance(of_camera, dict) else {}
    delay_ns = about.get("row_delay_ns")
    return float(delay_ns) if isinstance(delay_ns, int | float) else 0.0


def _sequences(path: Path) -> tuple[Path, Path]:
    """Where the `sequence.json` of a main camera, and of a further one, is."""
    whole = path.absolute()
    return whole.with_name(SEQUENCE), whole.parent.parent.parent / SEQUENCE


def _other_tool(path: Path, inside: Path | None) -> str:
    """What to do about a file that another tool wrote; "" for any other, and for one that cannot be read."""
    try:
        with opened(path, SETTINGS, inside=inside) as handle:
            return advice_on(path.suffix.lower(), handle.read(HEAD_BYTES))
    except UserError:
        return ""
