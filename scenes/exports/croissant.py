"""croissant.json: an export described for dataset search and for reviewers (MLCommons Croissant 1.0 with its RAI 1.0).

The publisher of an export adds what uavbench cannot know: licence, creator, URL and date.
"""

import json
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Any

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import file_hash
from uavbench.scenes.exports.notes import Held
from uavbench.trajectories.files.listed import tree
from uavbench.trajectories.files.writing import write_text

CROISSANT = "croissant.json"
MOST_NAMED = 8
"""Most files of one kind in a folder that are described individually; more become a FileSet."""
ENCODINGS = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".csv": "text/csv",
    ".txt": "text/plain",
    ".md": "text/markdown",
    ".json": "application/json",
    ".yaml": "application/yaml",
    ".toml": "application/toml",
    ".mp4": "video/mp4",
    ".ply": "model/ply",
    ".obj": "model/obj",
    ".db3": "application/vnd.sqlite3",
}
"""Media type by the suffix of a file; application/octet-stream for any other."""
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""The JSON-LD context of the specification."""
SIMULATED = {
    "rai:dataCollection": (
        "Rendered: a simulated quadrotor flies around a model of a structure, and a simulated camera records it. The "
        "poses are those of the simulation, without measurement error."
    ),
    "rai:dataCollectionType": ["Simulations"],
    "rai:dataAnnotationProtocol": "Poses, depth and masks are written by the renderer, without manual annotation.",
    "rai:dataBiases": (
        "One structure, environment and flight, as chosen in `config` of the sequence; materials, light and sensors "
        "are models. Errors on rendered images do not predict errors on real ones."
    ),
    "rai:dataUseCases": (
        "Comparison of trackers that localize a camera against a known model. Not for claims about a real vehicle or "
        "site, nor for training models that recognize people."
    ),
    "rai:personalSensitiveInformation": "None: people in the scene, where there are any, are synthetic figures.",
    "rai:dataReleaseMaintenancePlan": (
        "The config and seed in the sequence reproduce it; see the reproducibility page of uavbench."
    ),
    "rai:dataSocialImpact": "Localization serves inspection; the same methods could serve surveillance by drones.",
}
RECORDED = {
    "rai:dataCollection": "Images provided by their author and copied by uavbench.",
    "rai:dataCollectionType": ["Others"],
    "rai:personalSensitiveInformation": "Not known to uavbench: to be described by the publisher of the images.",
    "rai:dataUseCases": "Comparison of trackers that localize a camera against a known model.",
}


def write_croissant(sequence: Sequence, folder: Path, held: Held, not_held: Iterable[str]) -> None:
    """Describe all files of an export in its `croissant.json`; not_held become its limitations."""
    distribution = _files(folder)
    sets = [each for each in distribution if each["@type"] == "cr:FileSet" and each["encodingFormat"] == "image/png"]
    about: dict[str, Any] = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": sequence.name,
        "description": "; ".join(f"{name}: {what}" for name, what in held.files.items()),
        "version": str((sequence.info.get("versions") or {}).get("uavbench", "0.0.0")),
        "citeAs": "@software{uavbench, title={uavbench: ground truth for model-based UAV localization}}",
        "distribution": distribution,
        "recordSet": [_images(each) for each in sets],
        **(RECORDED if sequence.own_images else SIMULATED),
        "rai:dataLimitations": list(not_held) or ["None beyond those of the sequence, all of which is exported."],
    }
    write_text(folder / CROISSANT, json.dumps(about, indent=1) + "\n")


def _files(folder: Path) -> list[dict[str, Any]]:
    """A FileObject with digest per file, or a FileSet for many of one kind in one folder."""
    kinds: dict[tuple[str, str], list[str]] = defaultdict(list)
    for name in tree(folder):
        kinds[PurePosixPath(name).parent.as_posix(), PurePosixPath(name).suffix].append(name)
    described: list[dict[str, Any]] = []
    for (parent, suffix), names in kinds.items():
        encoding = ENCODINGS.get(suffix, "application/octet-stream")
        if len(names) > MOST_NAMED:
            pattern = f"{parent}/*{suffix}".removeprefix("./")
            described.append({"@type": "cr:FileSet", "@id": pattern, "encodingFormat": encoding, "includes": pattern})
            continue
        described += [
            {
                "@type": "cr:FileObject",
                "@id": name,
                "contentUrl": name,
                "encodingFormat": encoding,
                "sha256": file_hash(folder / name),
            }
            for name in names
        ]
    return described


def _images(file_set: dict[str, Any]) -> dict[str, Any]:
    """The RecordSet of a set of images, with one record per image."""
    name = f"images-of-{PurePosixPath(file_set['@id']).parent.as_posix()}"
    source = {"fileSet": {"@id": file_set["@id"]}}
    field = {"@type": "cr:Field", "@id": f"{name}/image", "dataType": "sc:ImageObject"}
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "field": [{**field, "source": {**source, "extract": {"fileProperty": "content"}}}],
    }
