"""Pydantic models generated from the plug-ins' dataclasses, so that lower packages need no validation library.

A plug-in is a plain frozen dataclass. Each gets a model with a discriminator `kind`, so that a TOML file is validated
as a whole and has a JSON Schema. Pydantic's dataclasses do not fit: their unions have no discriminator, and the vehicle
would have to import pydantic.
"""

import importlib
import sys
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, create_model

from uavbench.bench.config.plugins import DEFAULT_KINDS, PLUGINS
from uavbench.bench.inputs.observed.looks import watch
from uavbench.bench.inputs.plugin_files import declared, loaded
from uavbench.bench.inputs.plugin_kernels import edited_since_import, keep_by_content
from uavbench.tracker.faults import named, users_place
from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.sources.module_files import editable

Extra = tuple[tuple[str, type], ...]
INPUT_FILES = "input_files"
STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)


class Model(BaseModel):
    """Base of every config table: strict, without extra keys."""

    model_config = STRICT


@cache
def model_of(
    cls: type, extra: Extra = (), kind: str | None = None, omit: frozenset[str] = frozenset()
) -> type[BaseModel]:
    """Model of a dataclass; fields that hold a plug-in become a union discriminated by `kind`.

    extra: the user's own plug-ins (`module:attribute`, class), which the unions include; omit: fields that a config
    must not set.
    """
    hints = get_type_hints(cls, include_extras=True)
    needed = kind if kind in DEFAULT_KINDS.values() else ...
    members: dict[str, Any] = {} if kind is None else {"kind": (Literal[kind], needed)}
    for f in fields(cls):
        if not f.init or f.name in omit:
            continue
        annotation = _translate(hints[f.name], extra)
        if f.default is not MISSING and not is_dataclass(f.default) and not _holds_dataclass(f.default):
            members[f.name] = (annotation, f.default)
        elif f.default is not MISSING:
            members[f.name] = (annotation, Field(default_factory=lambda value=f.default: value))
        elif f.default_factory is not MISSING:
            members[f.name] = (annotation, Field(default_factory=f.default_factory))
        else:
            members[f.name] = (annotation, ...)
    if kind is not None and ":" in kind:
        members.setdefault(INPUT_FILES, (tuple[str, ...], ()))
    doc = (cls.__doc__ or "").split("\n")[0]
    name = cls.__name__ if kind is None else f"{cls.__name__}:{kind}"
    model: type[BaseModel] = create_model(name, __config__=STRICT, __doc__=doc, **members)
    setattr(model, "plugin_class", cls)  # noqa: B010
    return model


def build(model: Any, at: str, errors: list[str], **given: Any) -> Any:
    """Dataclass instance of a validated model; a ValueError of the class is added to `errors` under its key path.

    given: fields that the config does not set. For a user's own plug-in a config may set `input_files`, further files
    whose change makes its results stale, even if the plug-in has no such field.
    """
    if isinstance(model, tuple | list):
        return tuple(build(item, f"{at}[{i}]", errors) for i, item in enumerate(model))
    cls = getattr(type(model), "plugin_class", None)
    if cls is None:
        return model
    before = len(errors)
    values = {
        name: build(getattr(model, name), f"{at}.{name}" if at else name, errors)
        for name in type(model).model_fields
        if name in model.model_fields_set and name != "kind"
    }
    files = () if INPUT_FILES in {f.name for f in fields(cls)} else values.pop(INPUT_FILES, ())
    errors += [f"{at}.{INPUT_FILES}: {name} is not a file" for name in files if not Path(name).is_file()]
    if any(value is None and getattr(model, name, None) is not None for name, value in values.items()):
        assert len(errors) > before  # a part has a mistake, without which the whole cannot be made
        return None
    try:
        made = cls(**values, **given)
    except (ValueError, UserError) as error:
        errors.append(f"{at}: {error}")
        return None
    except Exception as error:  # a user's class may raise anything
        errors.append(f"{at}: {one_line(named(error))}{users_place(error)}")
        return None
    if files:
        _carry(made, files, at, errors)
    return made


def _carry(made: Any, files: tuple[str, ...], at: str, errors: list[str]) -> None:
    """Attach the names of input files to a plug-in without a field for them."""
    try:
        object.__setattr__(made, INPUT_FILES, files)
    except AttributeError:  # a class with slots
        errors.append(f"{at}.{INPUT_FILES}: {type(made).__name__} needs a field `{INPUT_FILES}: tuple[str, ...] = ()`")


def own_plugins(data: Any) -> Extra:
    """The user's plug-ins named by a config's `kind` keys as `module:attribute`.

    UserError with a line for each that cannot be imported, after the key that names it first.
    """
    found: dict[str, type] = {}
    mistakes: dict[str, str] = {}
    stack = [("", data)]
    while stack:
        at, item = stack.pop()
        if isinstance(item, Mapping):
            kind = item.get("kind")
            declared.update(_input_files(item))
            if isinstance(kind, str) and ":" in kind and kind not in found and kind not in mistakes:
                try:
                    found[kind] = import_plugin(kind)
                except UserError as error:
                    mistakes[kind] = f"{at}.kind: {error}" if at else str(error)
            stack.extend((f"{at}.{key}" if at else str(key), value) for key, value in item.items())
        elif isinstance(item, list):
            stack.extend((f"{at}[{i}]", value) for i, value in enumerate(item))
    if mistakes:
        several = [f"{len(mistakes)} mistakes"] if len(mistakes) > 1 else []
        raise UserError("\n  ".join([*several, *reversed(mistakes.values())]))  # the stack goes from the end
    return tuple(sorted(found.items()))


def _input_files(table: Mapping[str, Any]) -> Iterator[Path]:
    """The files that a table names as `input_files`, as far as it is valid."""
    given = table.get(INPUT_FILES)
    yield from (Path(name) for name in (given if isinstance(given, list | tuple) else ()) if isinstance(name, str))


def import_plugin(name: str) -> type:
    """Class of a plug-in named `module:attribute`.

    UserError when it cannot be imported, is no dataclass, or is not what its files say: results carry their hash.
    """
    module, _, attribute = name.partition(":")
    before = frozenset(sys.modules)
    keep_by_content()
    watch()
    try:
        cls = getattr(importlib.import_module(module), attribute)
    except Exception as error:  # a module may raise anything
        known = isinstance(error, ImportError | AttributeError)
        reason = (str(error) if known else named(error)) + users_place(error)
        raise UserError(f"plug-in {name!r} cannot be imported: {reason}; is its folder on PYTHONPATH?") from None
    if not (isinstance(cls, type) and is_dataclass(cls)):
        raise UserError(f"plug-in {name!r} must be a dataclass of its parameters")
    for made_in in {module, cls.__module__}:
        loaded[made_in] = loaded.get(made_in, frozenset()) | (frozenset(sys.modules) - before)
    if not _is_at_its_name(cls):
        raise UserError(
            f"plug-in {name!r} calls itself {cls.__module__}:{cls.__qualname__}, where it is not, so that its code is "
            "not known, nor can other processes load it; write it as a `class` at the top of a module, or give it that "
            f'module and name, as in make_dataclass("{attribute}", ..., namespace={{"__module__": __name__}})'
        )
    if not _is_in_a_file(cls.__module__):
        raise UserError(f"plug-in {name!r} is in no file, by which its results could be known; save it as MODULE.py")
    if edited := edited_since_import((cls.__module__, *loaded[cls.__module__])):
        was = "was edited after this Python had imported it; restart Python (in a notebook, the kernel)"
        raise UserError(f"plug-in {name!r}: {', '.join(edited)} {was}")
    return cls


def _is_at_its_name(cls: type) -> bool:
    """Whether a class is what its own module has under its own name, as one of `make_dataclass` may not be."""
    try:
        return bool(attrgetter(cls.__qualname__)(sys.modules[cls.__module__]) is cls)
    except (KeyError, AttributeError):
        return False


def _is_in_a_file(module: str) -> bool:
    """Whether the code of a module is in a file, as that of a notebook's cell or of standard input is not."""
    file = getattr(sys.modules.get(module), "__file__", None)
    return file is not None and (Path(file).is_file() or not editable(Path(file)))


def _translate(annotation: Any, extra: Extra) -> Any:
    """The annotation with dataclasses and plug-in protocols replaced by their models."""
    if annotation in PLUGINS:
        return choice(annotation, extra)
    if isinstance(annotation, type) and is_dataclass(annotation):
        return model_of(annotation, extra)
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return Annotated[(_translate(arguments[0], extra), *arguments[1:])]
    if origin is tuple:
        return tuple[tuple(a if a is Ellipsis else _translate(a, extra) for a in arguments)]  # type: ignore[misc]
    if origin in (Union, types.UnionType):
        return Union[tuple(_translate(a, extra) for a in arguments)]  # noqa: UP007
    return annotation


@cache
def choice(protocol: type, extra: Extra = ()) -> Any:
    """Union by `kind` of a protocol's registered plug-ins and the user's own that have its method."""
    registry, verb = PLUGINS[protocol]
    members = [model_of(cls, extra, kind) for kind, cls in registry.items()]
    if default := DEFAULT_KINDS.get(protocol):
        tagged = tuple(Annotated[model, Tag(kind)] for kind, model in zip(registry, members, strict=True))
        return Annotated[Union[tagged], Discriminator(_kind_or(default))]  # noqa: UP007
    members += [model_of(cls, extra, kind) for kind, cls in extra if hasattr(cls, verb)]
    if len(members) == 1:
        return members[0]
    return Annotated[Union[tuple(members)], Field(discriminator="kind")]  # noqa: UP007


def _kind_or(default: str) -> Callable[[Any], str]:
    """The kind of a table that may leave it out."""

    def kind_of(table: Any) -> str:
        return str(table.get("kind", default)) if isinstance(table, dict) else default

    return kind_of


def _holds_dataclass(value: Any) -> bool:
    return isinstance(value, tuple) and any(is_dataclass(item) for item in value)
