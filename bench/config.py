"""A suite: one TOML file in, checked specs out; all its mistakes are told at once."""

import difflib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, Field, ValidationError, create_model

from bench.config_paths import located
from bench.content import content_hash
from bench.models import STRICT, Extra, build, choice, model_of, own_plugins
from scenes.spec import SequenceSpec
from tracker.base import Tracker
from tracker.initial_pose import Initialization, Known
from tracker.recording import RecordingSpec
from tracker.run import KNOWN
from trajectories.errors import UserError
from trajectories.reading import read_toml

Protocol = Literal["reset", "anchors"]
Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_.-]*$", max_length=80)]


@dataclass(frozen=True)
class Suite:
    """A checked suite: sequences (one per name and seed), trackers by label, and the rates they run at.

    Its sequences are all rendered, or all recorded: without truth there is no error to set beside another.
    start is where the first pose comes from; protocols are those that trackers run in beside the free run; flights is
    the hash of what the file says of its sequences.
    """

    name: str
    title: str
    sequences: tuple[SequenceSpec | RecordingSpec, ...]
    trackers: dict[str, Tracker]
    rates_hz: tuple[float, ...]
    start: Initialization = KNOWN
    protocols: tuple[Protocol, ...] = ()
    flights: str = ""


def load_suite(path: Path) -> Suite:
    """Suite of a TOML file; UserError naming the file and every key that is wrong."""
    data, extra = _read(path)
    checked = _check(path, suite_model(extra), data)
    errors: list[str] = []
    sequences = tuple(
        build(table, f"{kind}.{name}", errors, name=f"{name}-s{seed}", seed=seed)
        for kind in ("sequences", "recordings")
        for name, table in getattr(checked, kind).items()
        for seed in checked.seeds
    )
    if bool(checked.sequences) == bool(checked.recordings):
        errors.append("give either `sequences`, which are rendered, or `recordings`, which are real images")
    trackers = {label: build(table, f"trackers.{label}", errors) for label, table in checked.trackers.items()}
    start = build(checked.start, "start", errors)
    errors += [
        f"rates_hz: {rate:g} Hz is more than the {spec.rate_hz:g} Hz of sequence {spec.name}"
        for spec in sequences
        for rate in checked.rates_hz
        if spec is not None and rate > spec.rate_hz
    ]
    if errors:
        raise UserError(_told(path, list(dict.fromkeys(errors))))
    protocols = tuple(dict.fromkeys(checked.protocols))
    flights = content_hash(data.get("sequences", data.get("recordings")), checked.seeds, data.get("start"))
    return Suite(path.stem, checked.title, sequences, trackers, tuple(checked.rates_hz), start, protocols, flights)


def load_tracker(path: Path) -> Tracker:
    """Tracker of a TOML file that holds the table of one; UserError naming the file and every key that is wrong."""
    data, extra = _read(path)
    return tracker_of(data, path, extra)


def tracker_of(data: dict[str, Any], path: Path, extra: Extra = ()) -> Tracker:
    """Tracker of a table that stands in a file; UserError naming the file and every key that is wrong."""
    one: Any = choice(Tracker, extra)
    table = _check(path, create_model("File", __config__=STRICT, tracker=(one, ...)), {"tracker": data})
    errors: list[str] = []
    tracker: Tracker = build(table.tracker, "tracker", errors)
    if errors:
        raise UserError(_told(path, errors))
    return tracker


@cache
def suite_model(extra: Extra = ()) -> type[BaseModel]:
    """Model of a suite file; its `model_json_schema()` is the JSON Schema for editors."""
    sequence: Any = model_of(SequenceSpec, extra, omit=frozenset({"name", "seed"}))
    recording: Any = model_of(RecordingSpec, extra, omit=frozenset({"name", "seed"}))
    tracker: Any = choice(Tracker, extra)
    start: Any = choice(Initialization, extra)
    known = model_of(Known, extra, "known").model_construct
    return create_model(
        "Suite",
        __config__=STRICT,
        __doc__="A uavbench suite: what is rendered, which trackers run on it, and at which rates.",
        title=(str, ...),
        seeds=(Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)], [0]),
        rates_hz=(Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=1)], ...),
        start=(start, Field(default_factory=known)),
        protocols=(list[Protocol], []),
        sequences=(dict[Name, sequence], {}),
        recordings=(dict[Name, recording], {}),
        trackers=(Annotated[dict[Name, tracker], Field(min_length=1)], ...),
    )


def _read(path: Path) -> tuple[dict[str, Any], Extra]:
    """Content of a TOML file and the user's plug-ins that it names."""
    data = read_toml(path, hint="; `uavbench list` shows the suites that come with uavbench")
    try:
        return data, own_plugins(data)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def _check(path: Path, model: type[BaseModel], data: dict[str, Any]) -> Any:
    """The config as its model; UserError with a line for each mistake."""
    config, mistakes = located(data, path.parent)
    try:
        checked = model.model_validate_json(json.dumps(config, default=str))
    except ValidationError as error:
        mistakes += [_explain(model, e) for e in error.errors()]
    if mistakes:
        raise UserError(_told(path, mistakes))
    return checked


def _told(path: Path, messages: list[str]) -> str:
    count = f"{len(messages)} mistakes" if len(messages) > 1 else "1 mistake"
    return f"{path}: {count}\n" + "\n".join(f"  {message}" for message in messages)


def _explain(model: type[BaseModel], error: Any) -> str:
    """One line of a validation error: key path, what is wrong, and the nearest valid name."""
    keys, tables = zip(*_walk(model, error["loc"]), strict=True) if error["loc"] else ((), ())
    path = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys if k is not None).lstrip(".")
    context = error.get("ctx", {})
    match error["type"]:
        case "extra_forbidden":
            valid = [name for name in tables[-1].model_fields if name != "kind"] if tables[-1] else []
            return f"{path}: unknown key{_nearest(str(keys[-1]), valid)}"
        case "union_tag_invalid":
            valid = [name.strip().strip("'") for name in context["expected_tags"].split(",")]
            return f"{path}.kind: unknown kind {context['tag']!r}{_nearest(context['tag'], valid)}"
        case "union_tag_not_found":
            return f"{path}: `kind` is missing"
        case "missing" if keys[-1] == "kind":
            return f"{path.removesuffix('.kind')}: `kind` is missing"
        case "missing":
            return f"{path}: this key is missing"
        case _:
            got = error["input"]
            shown = f", got {got!r}" if not isinstance(got, dict | list) else ""
            return f"{path}: {error['msg'][:1].lower()}{error['msg'][1:]}{shown}"


def _nearest(name: str, valid: list[str]) -> str:
    near = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{hint} (valid: {', '.join(valid)})"


def _walk(model: Any, location: tuple[str | int, ...]) -> Iterator[tuple[str | int | None, type[BaseModel] | None]]:
    """Each step of an error's location as (key, model that the key is looked up in); a union's tag has no key."""
    here: Any = model
    for step in location:
        here = _bare(here)
        if isinstance(here, type) and issubclass(here, BaseModel):
            yield step, here
            field = here.model_fields.get(str(step))
            here = field.annotation if field else None
        elif get_origin(here) in (list, tuple, dict):
            yield step, None
            here = get_args(here)[-1 if get_origin(here) is dict else 0]
        else:
            members = [m for m in get_args(here) if isinstance(m, type) and issubclass(m, BaseModel)]
            tagged = [
                m for m in members if "kind" in m.model_fields and step in get_args(m.model_fields["kind"].annotation)
            ]
            yield (None if tagged else step), None
            here = tagged[0] if tagged else None


def _bare(annotation: Any) -> Any:
    """The annotation without Annotated."""
    while hasattr(annotation, "__metadata__"):
        annotation = annotation.__origin__
    return annotation
