"""Airframes read from a user's own file."""

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.files.limits import MOST_NESTING
from uavbench.trajectories.files.reading import read_text, toml_table
from uavbench.trajectories.vehicle.airframes import PRESETS, Crazyflie, with_camera

GROWING = ("replicate", "composite", "flexcomp", "flex", "skin", "hfield", "texture", "extension", "plugin", "size")
"""MJCF elements that expand to more than their text, or load code."""

MOST_ELEMENTS = 1_000
"""Elements of an MJCF file: quadrotor.xml has 27, and MuJoCo's time to read them is quadratic."""
MOST_ATTRIBUTES = 100
"""Attributes of an element of an MJCF file: the longest have 40, and MuJoCo's time is quadratic in them."""


@dataclass(frozen=True)
class AirframeFile:
    """A user's own vehicle: a TOML file with fields of `Crazyflie`, or an MJCF file shaped like quadrotor.xml.

    Fields that the TOML leaves out keep the values of the airframe it names as `like` (default: crazyflie).
    """

    path: str = "airframe.toml"

    def build(self, mount: Mount) -> str:
        """MJCF of the vehicle; UserError naming the file and key."""
        return read_airframe(Path(self.path), mount)


def read_airframe(path: Path, mount: Mount) -> str:
    """MJCF of the airframe of a TOML or MJCF file; UserError naming the file, and the invalid key."""
    from uavbench.trajectories.vehicle.quadrotor import Quadrotor  # MuJoCo

    text = read_text(path)
    try:
        xml = _from_xml(text, mount) if path.suffix.lower() in (".xml", ".mjcf") else _from_toml(text).build(mount)
        Quadrotor.from_mjcf(xml)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    return xml


def _from_xml(text: str, mount: Mount) -> str:
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise UserError(f"not valid XML: {error}") from None
    _refuse_growth(root)
    for node in root.iter():
        for key in node.attrib:
            if key.startswith("file"):  # <include file=...>, meshes, textures, height fields
                raise UserError(
                    f"<{node.tag} {key}=...> refers to another file; an airframe is a single file without meshes"
                )
    return with_camera(root, mount)


def _refuse_growth(root: ElementTree.Element) -> None:
    """UserError for elements that expand to more than their text, too many elements, and too deep nesting."""
    count = sum(1 for _ in root.iter())
    if count > MOST_ELEMENTS:
        raise UserError(
            f"it has {count:,} elements, more than the {MOST_ELEMENTS:,} that can be handled; "
            "leave out shapes that are for display only"
        )
    if max(len(node.attrib) for node in root.iter()) > MOST_ATTRIBUTES:
        raise UserError(f"one of its elements has more than {MOST_ATTRIBUTES} attributes; export the file again")
    level = [root]
    for _ in range(MOST_NESTING):
        for node in level:
            if node.tag in GROWING or (node.tag == "numeric" and "size" in node.attrib):
                raise UserError(f"<{node.tag}>: not allowed; an airframe is a single body of primitive shapes")
        level = [child for node in level for child in node]
    if level:
        raise UserError(f"it is nested deeper than {MOST_NESTING} levels")


def _from_toml(text: str) -> Crazyflie:
    try:
        table = toml_table(text)
    except ValueError as error:
        raise UserError(f"not valid TOML: {error}") from None
    base = str(table.pop("like", "crazyflie"))
    kind = PRESETS.get(base)
    if kind is None:
        raise unknown_name("airframe `like`", base, list(PRESETS))
    names = [field.name for field in fields(kind)]
    for key in table:
        if key not in names:
            raise unknown_name("key", key, names)
    try:
        return TypeAdapter(kind).validate_json(
            json.dumps(table, default=str)
        )  # of which arrays are tuples, even strictly
    except ValidationError as error:
        raise UserError("; ".join(map(_told, error.errors()))) from None


def _told(error: Any) -> str:
    """What is wrong with which key, and with which of its numbers."""
    path, got = ".".join(map(str, error["loc"])), error["input"]
    shown = "" if isinstance(got, dict | list) else f", got {got!r}"
    return f"{path}: {error['msg']}{shown}" if path else str(error["msg"]).removeprefix("Value error, ")
