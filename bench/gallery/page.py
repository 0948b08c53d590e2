"""The page of the gallery: a section for each registry, and for parameters; each picture with a sentence."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from PIL import Image as Pillow

from uavbench.bench.config.plugins import PLUGINS
from uavbench.bench.gallery.annotations import annotation_picture
from uavbench.bench.gallery.cameras import cameras_picture
from uavbench.bench.gallery.examples import Example, example_of, options
from uavbench.bench.gallery.flights import path_picture, sensor_picture
from uavbench.bench.gallery.scenes import (
    effect_picture,
    environment_picture,
    mount_picture,
    site_picture,
    structure_picture,
)
from uavbench.scenes.spec import ClutterSpec, EffectSpec, EnvironmentSpec, SequenceSpec, StructureSpec
from uavbench.tracker.protocol import Image
from uavbench.trajectories.camera_mount import MountSpec
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.paths.registry import PathSpec
from uavbench.trajectories.sensors.sensor import SensorSpec

MARKER = Marker("gallery.json", "gallery")
WEBP_QUALITY = 80


@dataclass(frozen=True)
class Section:
    """Plug-ins of one registry.

    about: sentence under the title; key: key of a sequence's table that names such a plug-in; picture: draws the
    example sequence of one, an image (h, w, 3) BGR.
    """

    title: str
    about: str
    key: str
    picture: Callable[[SequenceSpec], Image]


SECTIONS: dict[object, Section] = {
    StructureSpec: Section("Structures", "The objects of inspection.", "structure", structure_picture),
    EnvironmentSpec: Section(
        "Environments", "Ground, walls, sky and light around the structure.", "environment", environment_picture
    ),
    ClutterSpec: Section("Clutter", "Objects around the structure, static or moving.", "clutter", environment_picture),
    EffectSpec: Section(
        "Effects",
        "What shutter, lens, sensor, processing and link do to the image, mostly more of it than usual: left without, "
        "right with it; or six frames in a row where some of them do not arrive.",
        "effects",
        effect_picture,
    ),
    PathSpec: Section(
        "Paths", "A flight from its start (dot), dark to light, with the direction of the view.", "path", path_picture
    ),
    MountSpec: Section(
        "Camera mounts",
        "Six frames of one flight, in which the vehicle tilts by up to 19 degrees.",
        "mount",
        mount_picture,
    ),
    SensorSpec: Section("Sensors", "Measurements on board, over ten seconds.", "sensors", sensor_picture),
}
"""Protocol -> its section."""
OPTIONS: dict[str, tuple[Section, object, str]] = {
    "conditions": (
        Section("Light, weather and ground", "Parameters of an environment.", "condition", environment_picture),
        EnvironmentSpec,
        "reference/plugins.md",
    ),
    "sites": (
        Section(
            "Sites",
            "What the table [`site`](sites.md) adds to an environment: left without, right with it.",
            "site",
            site_picture,
        ),
        EnvironmentSpec,
        "sites.md",
    ),
    "cameras": (
        Section("Cameras", "Lenses, and several cameras on one vehicle.", "cameras", cameras_picture),
        MountSpec,
        "datasets.md#several-cameras-and-their-clock",
    ),
    "annotations": (
        Section(
            "Ground truth of a frame",
            "What `annotations` write beside an image, in colours; the files hold metres, pixels and unit vectors.",
            "annotation",
            annotation_picture,
        ),
        SensorSpec,
        "datasets.md#annotations",
    ),
}
"""Key of examples of parameters -> their section, the protocol after whose section it stands, and where they lead."""


def write_gallery(folder: Path) -> None:
    """Write gallery.md and the subfolder `gallery` with a WebP picture of every plug-in into a folder.

    UserError when an example is not valid, or the subfolder or gallery.md is not one that uavbench wrote.
    """
    parts = ["# Gallery\n\nWhat a suite can name, drawn by the code: `python -m uavbench.bench.gallery DIR`.\n"]
    with new_folder(folder / "gallery", MARKER) as pictures:
        for protocol, section in SECTIONS.items():
            of_kind = {k: example_of(section.key, k, plugin) for k, plugin in PLUGINS[protocol][0].items()}
            parts.append(_section(section, of_kind, "reference/plugins.md#{}", pictures))
            for key, (option, after, link) in OPTIONS.items():
                if after is protocol:
                    parts.append(_section(option, options(key), link, pictures))
    write_text(folder / "gallery.md", "\n".join(parts), kind=MARKER.kind)


def _section(section: Section, examples: Mapping[str, Example], link: str, pictures: Path) -> str:
    """A section in Markdown; its pictures are written into a folder. link: target of each caption."""
    parts = [f'## {section.title}\n\n{section.about}\n\n<div class="gallery" markdown>\n']
    for name, example in examples.items():
        file = f"{section.key}-{name}.webp"
        image = Pillow.fromarray(section.picture(example.spec)[..., ::-1])
        image.save(pictures / file, format="WEBP", quality=WEBP_QUALITY, method=4)
        size = f"width={image.width} height={image.height}"
        parts.append(
            f"<figure markdown>\n![{name}](gallery/{file}){{ loading=lazy {size} }}\n"
            f'<figcaption markdown="span">[`{name}`]({link.format(name)}) {_caption(example)}</figcaption>\n</figure>\n'
        )
    return "\n".join([*parts, "</div>\n"])


def _caption(example: Example) -> str:
    shown = ", ".join(f"`{key} = {json.dumps(value)}`" for key, value in example.own.items())
    return example.about + (f" Shown with {shown}." if shown else "")
