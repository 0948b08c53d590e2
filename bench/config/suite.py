"""Reads a suite from a TOML file into validated specs; all errors are reported at once."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError, create_model

from uavbench.bench.closed_loop.spec import LoopSpec
from uavbench.bench.config.loops import idle_keys, loop_mistakes, with_shared_loop
from uavbench.bench.config.plugin_models import STRICT, Extra, build, choice, model_of, own_plugins
from uavbench.bench.config.plugins import PLUGINS
from uavbench.bench.config.validation_errors import explain
from uavbench.bench.inputs.content_hash import content_hash, contents
from uavbench.bench.inputs.file_paths import located
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.images.recorded_sequence import RecordingSpec
from uavbench.tracker.initialization import Initialization, Known
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.run import KNOWN, nearest_stride, whole_stride
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_toml

Protocol = Literal["reset", "anchors"]
MOST_SEEDS = 10_000
"""Most seeds of a suite; every sequence is flown once per seed."""
Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_.-]*$", max_length=80)]

FLOWN = ("sequences", "recordings", "start", "loop", "loops")
"""Tables of a suite that tell what is flown."""


@dataclass(frozen=True)
class Suite:
    """A validated suite: sequences (one per name and seed), trackers by label, and the rates at which they run.

    Its sequences are either all rendered or all recorded, and of the latter all have ground truth or none has, since
    errors need it. start: source of the initial pose; protocols: protocols run in addition to the free run; flights:
    hash of the file's keys that concern sequences, and of the files that these name; loops: closed-loop configurations
    by name, "" for a single one, empty for a suite that is not flown.
    """

    name: str
    title: str
    sequences: tuple[SequenceSpec | RecordingSpec, ...]
    trackers: dict[str, Tracker]
    rates_hz: tuple[float, ...]
    start: Initialization = KNOWN
    protocols: tuple[Protocol, ...] = ()
    flights: str = ""
    loops: Mapping[str, LoopSpec] = field(default_factory=dict)


def load_suite(path: Path) -> Suite:
    """Read a suite from a TOML file; UserError naming the file and every invalid key."""
    return suite_of(*_read(path, "; `uavbench list` shows the suites that come with uavbench"), path)


def suite_of(data: dict[str, Any], extra: Extra, path: Path) -> Suite:
    """Suite from a file's tables; relative paths are resolved against the file's folder. UserError as `load_suite`."""
    as_given, data = data, with_shared_loop(data)
    checked = _check(path, suite_model(extra), data, _repeated(data))
    errors: list[str] = []
    sequences = tuple(
        build(table, f"{kind}.{name}", errors, name=f"{name}-s{seed}", seed=seed)
        for kind in ("sequences", "recordings")
        for name, table in getattr(checked, kind).items()
        for seed in checked.seeds
    )
    if bool(checked.sequences) == bool(checked.recordings):
        errors.append("give either `sequences`, which are rendered, or `recordings`, which are real images")
    without = [name for name, table in checked.recordings.items() if not table.ground_truth_file]
    if 0 < len(without) < len(checked.recordings):
        errors.append(
            f"recordings.{without[0]}: has no ground_truth_file, as others have; put those without into a suite of "
            "their own, whose report has no errors"
        )
    trackers = {label: build(table, f"trackers.{label}", errors) for label, table in checked.trackers.items()}
    start = build(checked.start, "start", errors)
    loops = {name: build(table, f"loops.{name}", errors) for name, table in checked.loops.items()}
    if checked.loop is not None and not loops:
        loops = {"": build(checked.loop, "loop", errors)}
    errors += [
        line for name, loop in loops.items() if loop is not None for line in loop_mistakes(name, loop, sequences)
    ]
    errors += idle_keys(as_given, loops)
    errors += [
        line for spec in sequences if spec is not None for line in _rate_mistakes(checked.rates_hz, spec, bool(loops))
    ]
    errors += _same_flights([spec for spec in sequences if spec is not None and spec.seed == checked.seeds[0]])
    if errors:
        raise UserError(_message(path, list(dict.fromkeys(errors))))
    read = checked.model_dump(exclude_unset=True, warnings=False)
    given = {key: _as_read(data[key], read.get(key)) for key in FLOWN if key in data}
    more = [given.get("loop"), given.get("loops")] if loops else []
    if files := contents([spec for spec in sequences if spec.seed == checked.seeds[0]]):
        more.append(files)
    flights = content_hash(given.get("sequences", given.get("recordings")), checked.seeds, given.get("start"), *more)
    return Suite(
        name=path.stem,
        title=checked.title,
        sequences=sequences,
        trackers=trackers,
        rates_hz=tuple(checked.rates_hz),
        start=start,
        protocols=tuple(checked.protocols),
        flights=flights,
        loops=loops,
    )


def _as_read(given: Any, read: Any) -> Any:
    """A value of a file with its whole numbers as they were read, so that 65 is 65.0 where a float is asked for."""
    if isinstance(given, dict) and isinstance(read, Mapping):
        return {key: _as_read(value, read.get(key)) for key, value in given.items()}
    if isinstance(given, list) and isinstance(read, list | tuple) and len(given) == len(read):
        return [_as_read(*pair) for pair in zip(given, read, strict=True)]
    return read if type(given) is int and type(read) is float else given


def load_tracker(path: Path) -> Tracker:
    """Read a tracker from a TOML file with its table; UserError naming the file and every invalid key."""
    data, extra = _read(path, "; write a table such as kind = 'robust' into a TOML file and name that")
    return tracker_of(data, path, extra)


def tracker_of(data: dict[str, Any], path: Path, extra: Extra = ()) -> Tracker:
    """Tracker from a table of a file; UserError naming the file and every invalid key."""
    tracker: Tracker = _one(Tracker, "tracker", data, path, extra)
    return tracker


def start_of(data: dict[str, Any], path: Path, extra: Extra = ()) -> Initialization:
    """Initialization from a table of a file; UserError as `tracker_of`."""
    start: Initialization = _one(Initialization, "start", data, path, extra)
    return start


def recorded_spec(data: dict[str, Any], path: Path) -> SequenceSpec:
    """Spec from a table of a sequence's record, which must not name user plug-ins; UserError as `tracker_of`."""
    spec: SequenceSpec = _one(SequenceSpec, "config", data, path, ())
    return spec


def _one(sort: type, key: str, data: dict[str, Any], path: Path, extra: Extra) -> Any:
    """Plug-in or spec from a table; key: its name in errors."""
    kind: Any = choice(sort, extra) if sort in PLUGINS else model_of(sort, extra)
    fields: Any = {key: (kind, ...)}
    table = _check(path, create_model("File", __config__=STRICT, **fields), {key: data})
    errors: list[str] = []
    plugin = build(getattr(table, key), key, errors)
    if errors:
        raise UserError(_message(path, errors))
    return plugin


@cache
def suite_model(extra: Extra = ()) -> type[BaseModel]:
    """Model of a suite file; its `model_json_schema()` is the JSON Schema for editors."""
    sequence: Any = model_of(SequenceSpec, extra, omit=frozenset({"name", "seed"}))
    recording: Any = model_of(RecordingSpec, extra, omit=frozenset({"name", "seed"}))
    tracker: Any = choice(Tracker, extra)
    start: Any = choice(Initialization, extra)
    loop: Any = model_of(LoopSpec, extra)
    known = model_of(Known, extra, "known").model_construct
    return create_model(
        "Suite",
        __config__=STRICT,
        __doc__="A uavbench suite: what is rendered, which trackers run on it, and at which rates.",
        title=(str, ...),
        seeds=(Annotated[list[Annotated[int, Field(ge=0, lt=2**63)]], Field(min_length=1, max_length=MOST_SEEDS)], [0]),
        rates_hz=(Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=1)], ...),
        start=(start, Field(default_factory=known)),
        protocols=(list[Protocol], []),
        sequences=(dict[Name, sequence], {}),
        recordings=(dict[Name, recording], {}),
        trackers=(Annotated[dict[Name, tracker], Field(min_length=1)], ...),
        loop=(loop, None),
        loops=(dict[Name, loop], {}),
    )


def _read(path: Path, hint: str) -> tuple[dict[str, Any], Extra]:
    """Content of a TOML file, and the user's plug-ins that it names; hint: what to do when there is no such file."""
    data = read_toml(path, hint=hint)
    return data, plugins_named(data, path)


def plugins_named(data: dict[str, Any], path: Path) -> Extra:
    """The user's plug-ins that the tables of a file name; UserError naming the file."""
    try:
        return own_plugins(located(data, path.parent)[0])
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def _repeated(data: dict[str, Any]) -> list[str]:
    """An error line for each seed, rate or protocol that is repeated, or whose results would share a folder."""
    lines = []
    for key in ("seeds", "rates_hz", "protocols"):
        first: dict[str, int] = {}
        given: list[Any] = data[key] if isinstance(data.get(key), list) else []
        for i, value in enumerate(given):
            written = f"{value:g}" if key == "rates_hz" and isinstance(value, float) else str(value)
            same = first.setdefault(written, i)
            if same != i:
                alike = f", {given[same]!r}: both are written {written}" if value != given[same] else ""
                lines.append(f"{key}[{i}]: {value!r} repeats {key}[{same}]{alike}; remove one")
    return lines


def _rate_mistakes(rates_hz: list[float], spec: SequenceSpec | RecordingSpec, flown: bool) -> list[str]:
    """An error line for each rate that no stride of a sequence has, or that selects the same frames as an earlier one.

    The rate of a recording is not the user's choice: the nearest stride of it is taken.
    flown: whether the suite is flown in closed loop, where frames are exposed at any rate up to the sequence's.
    """
    lines: list[str] = []
    first: dict[int, float] = {}
    for i, rate_hz in enumerate(rates_hz):
        try:
            served = flown and rate_hz <= spec.rate_hz
            of = nearest_stride if isinstance(spec, RecordingSpec) else whole_stride
            stride = -i if served else of(spec.rate_hz, rate_hz, spec.name)
        except UserError as error:
            lines.append(f"rates_hz[{i}]: {error}")
            continue
        if first.setdefault(stride, rate_hz) != rate_hz:
            lines.append(
                f"rates_hz[{i}]: {rate_hz:g} Hz has stride {stride} in sequence {spec.name} ({spec.rate_hz:g} Hz), "
                f"as has {first[stride]:g} Hz; remove one"
            )
    return lines


def _same_flights(specs: Sequence[SequenceSpec | RecordingSpec]) -> list[str]:
    """An error line for each sequence that equals an earlier one except for its name: its runs would count twice."""
    unnamed = [replace(spec, name="") for spec in specs]
    names = [spec.name.removesuffix(f"-s{spec.seed}") for spec in specs]
    table = "recordings" if any(isinstance(spec, RecordingSpec) for spec in specs) else "sequences"
    return [
        f"{table}.{name}: equals {names[first]} except for its name; remove one"
        for i, name in enumerate(names)
        if (first := unnamed.index(unnamed[i])) != i
    ]


def _check(path: Path, model: type[BaseModel], data: dict[str, Any], more: Sequence[str] = ()) -> Any:
    """The config as its model; UserError with a line for each error, including those in `more`."""
    config, mistakes = located(data, path.parent)
    mistakes += more
    try:
        checked = model.model_validate_json(json.dumps(config, default=str))
    except ValidationError as error:
        mistakes += [explain(model, e) for e in error.errors()]
    if mistakes:
        raise UserError(_message(path, mistakes))
    return checked


def _message(path: Path, messages: list[str]) -> str:
    count = f"{len(messages)} mistakes" if len(messages) > 1 else "1 mistake"
    return f"{path}: {count}\n" + "\n".join(f"  {message}" for message in messages)
