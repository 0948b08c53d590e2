"""Readable validation errors of a config: path of the key, what is wrong, and the nearest valid name."""

import difflib
import json
import re
from collections.abc import Iterator
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from uavbench.bench.config.plugins import DEFAULT_KINDS, PLUGINS
from uavbench.bench.inputs.plugin_files import loaded
from uavbench.scenes.calibrations.other_tools import own_name

NAMED_TABLES = ("sequences", "recordings", "trackers", "loops")
"""Keys of a suite that hold tables, each with a name of its own."""
REMOVED = {("CameraClock", "even"): "frames are always evenly spaced; delete this key"}
"""Keys of earlier versions by model and name, and what to do about them."""

NAMES = "cannot be a name: use lower-case letters, digits, _ . and -, a letter or digit first"
BARE = re.compile(r"[A-Za-z0-9_-]+")
"""Key that TOML takes without quotes."""


def explain(model: type[BaseModel], error: Any) -> str:
    """One line for a pydantic error: key path, what is wrong, and the nearest valid name."""
    keys, tables = zip(*_walk(model, error["loc"]), strict=True) if error["loc"] else ((), ())
    path = _path(keys)
    context = error.get("ctx", {})
    match error["type"]:
        case "extra_forbidden":
            if tables[-1] and (advice := REMOVED.get((tables[-1].__name__, str(keys[-1])))):
                return f"{path}: {advice}"
            valid = [name for name in tables[-1].model_fields if name != "kind"] if tables[-1] else []
            if elsewhere := _elsewhere(keys, tables):
                if "." not in elsewhere:
                    return f"{path}: unknown key here; {elsewhere!r} is a key of the suite: write it above all tables"
                return f"{path}: unknown key here; did you mean {elsewhere!r}?"
            return f"{path}: unknown key{_nearest(str(keys[-1]), valid)}"
        case "union_tag_invalid":
            valid = [name.strip().strip("'") for name in context["expected_tags"].split(",")]
            return f"{path}.kind: {_unknown_kind(context['tag'], valid)}"
        case "union_tag_not_found":
            return f"{path}: `kind` is missing"
        case "missing" if keys[-1] == "kind":
            return f"{path.removesuffix('.kind')}: `kind` is missing"
        case "string_pattern_mismatch" if keys[-1] == "[key]":
            return f"{_path(keys[:-2])}.{_quoted(str(keys[-2]))}: {NAMES}"
        case "missing":
            return f"{path}: this key is missing"
        case "literal_error" if keys[-1] == "distortion_model" and (known := own_name(str(error["input"]))):
            return f"{path}: {error['input']!r} is {known!r} here"
        case "list_type" | "tuple_type":
            return f"{path}: must be a list, in square brackets, also of one item{_got(error['input'])}"
        case "dict_type" if keys[-1] in NAMED_TABLES:
            return f"{path}: must be tables with names, as [{path}.NAME]{_got(error['input'])}"
        case "dict_type" if isinstance(error["input"], str):
            return f"{path}: must be a table, as {{ kind = {json.dumps(error['input'])} }}"
        case "dict_type" | "model_type":
            return f"{path}: must be a table, in braces{_got(error['input'])}"
        case _:
            return f"{path}: {error['msg'][:1].lower()}{error['msg'][1:]}{_got(error['input'])}"


def _got(given: Any) -> str:
    """What was given, unless it is a table or list."""
    return f", got {given!r}" if not isinstance(given, dict | list) else ""


def _unknown_kind(kind: str, valid: list[str]) -> str:
    """What is wrong with a kind that is not valid; a plug-in that was imported lacks the method of its place."""
    module, colon, attribute = kind.partition(":")
    verbs = [
        verb
        for protocol, (kinds, verb) in PLUGINS.items()
        if protocol not in DEFAULT_KINDS and set(valid) >= set(kinds)
    ]
    if colon and module in loaded and verbs:
        return f"plug-in {kind!r} cannot be used here: its class {attribute} has no method `{verbs[0]}`"
    return f"unknown kind {kind!r}{_nearest(kind, valid)}"


def _elsewhere(keys: tuple[Any, ...], tables: tuple[Any, ...]) -> str:
    """Path at which a misplaced key would be valid, in an enclosing or a sibling table; "" if there is none."""
    name = str(keys[-1])
    for depth in range(len(keys) - 2, -1, -1):
        if keys[depth] != name and tables[depth] is not None and name in tables[depth].model_fields:
            return _path((*keys[:depth], name))
    for beside, known in tables[-1].model_fields.items() if tables[-1] else ():
        inner, more = _bare(known.annotation), [name]
        if get_origin(inner) is dict:
            inner, more = _bare(get_args(inner)[-1]), ["NAME", name]
        if isinstance(inner, type) and issubclass(inner, BaseModel) and name in inner.model_fields:
            return _path((*keys[:-1], beside, *more))
    return ""


def _path(keys: tuple[Any, ...]) -> str:
    """Dotted path of keys in a config; None for a step without a key, such as a union's tag."""
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys if k is not None).lstrip(".")


def _quoted(name: str) -> str:
    """Name of a table as TOML has it."""
    return name if BARE.fullmatch(name) else json.dumps(name)


def _nearest(name: str, valid: list[str]) -> str:
    near = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{hint} (valid: {', '.join(valid)})"


def _walk(model: Any, location: tuple[str | int, ...]) -> Iterator[tuple[str | int | None, type[BaseModel] | None]]:
    """Steps of an error's location as (key, model with this key); the key is None for a union's tag."""
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
            members = [m for m in map(_bare, get_args(here)) if isinstance(m, type) and issubclass(m, BaseModel)]
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
