"""Every registered plug-in keeps the same promises."""

import inspect
from dataclasses import FrozenInstanceError, fields, is_dataclass
from types import UnionType
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest
from annotated_types import Interval
from pydantic import ValidationError

from uavbench.bench.config.plugin_models import build, model_of
from uavbench.bench.config.plugins import PLUGINS
from uavbench.bench.inputs.content_hash import content_hash

ALL = [
    pytest.param(kind, cls, verb, id=f"{protocol.__name__}-{kind}")
    for protocol, (registry, verb) in PLUGINS.items()
    for kind, cls in registry.items()
]


def has_defaults(cls):
    signature = inspect.signature(cls)
    return all(p.default is not inspect.Parameter.empty for p in signature.parameters.values())


@pytest.mark.parametrize(("kind", "cls", "verb"), ALL)
def test_a_plugin_is_a_documented_frozen_dataclass_with_its_verb(kind, cls, verb):
    assert is_dataclass(cls)
    assert cls.__dataclass_params__.frozen
    assert callable(getattr(cls, verb))
    assert cls.__doc__
    assert not cls.__doc__.startswith(f"{cls.__name__}(")
    assert kind == kind.lower()


@pytest.mark.parametrize(("kind", "cls", "verb"), [p for p in ALL if has_defaults(p.values[1])])
def test_a_plugin_comes_from_an_empty_table_as_it_comes_from_its_constructor(kind, cls, verb):
    errors = []
    built = build(model_of(cls, (), kind).model_validate_json(f'{{"kind": "{kind}"}}'), "at", errors)
    assert errors == []
    assert type(built) is cls
    assert content_hash(built) == content_hash(cls())


@pytest.mark.parametrize(("kind", "cls", "verb"), ALL)
def test_a_plugin_refuses_a_key_that_it_does_not_have(kind, cls, verb):
    with pytest.raises(ValidationError, match="no_such_key"):
        model_of(cls, (), kind).model_validate_json(f'{{"kind": "{kind}", "no_such_key": 1}}')


@pytest.mark.parametrize(("kind", "cls", "verb"), [p for p in ALL if has_defaults(p.values[1])])
def test_a_plugin_is_a_value_that_does_not_change(kind, cls, verb):
    value = cls()
    for f in fields(cls):
        with pytest.raises(FrozenInstanceError):
            setattr(value, f.name, None)


SIGNED = {"margin_m", "overrun_m"}
"""Numbers beside angles that may be anything: distances beyond the structure, negative ones stop short of it."""


def numbers(cls):
    """Name, type and bounds of every field that is one number."""
    for name, hint in get_type_hints(cls, include_extras=True).items():
        for one in (hint, *get_args(hint)) if get_origin(hint) is UnionType else (hint,):
            kind, *metadata = get_args(one) if get_origin(one) is Annotated else (one,)
            if kind in (int, float):
                yield name, kind, [bound for m in metadata for bound in (m if isinstance(m, Interval) else [m])]


def taken(cls, kind, name, value):
    """Whether the config takes a value of a field."""
    try:
        model_of(cls, (), kind).model_validate({"kind": kind, name: value})
    except ValidationError as error:  # that others are missing does not count
        return not any(part["loc"][:1] == (name,) for part in error.errors())
    return True


@pytest.mark.parametrize(("kind", "cls", "verb"), ALL)
def test_every_number_has_bounds_and_is_refused_just_beyond_them(kind, cls, verb):
    for name, number, bounds in numbers(cls):
        if name in SIGNED:
            continue
        assert bounds, f"{cls.__name__}.{name}: no bound"
        assert not taken(cls, kind, name, float("nan")), name
        assert not taken(cls, kind, name, float("inf")), name
        for bound in bounds:
            (part,) = fields(bound)
            word, limit = part.name, getattr(bound, part.name)
            beyond = limit - 1 if word in ("gt", "ge") else limit + 1
            step = 1 if number is int else 1e-6 * max(1.0, abs(limit))
            inner = limit + step if word in ("gt", "ge") else limit - step
            assert not taken(cls, kind, name, number(beyond)), (name, beyond)
            assert taken(cls, kind, name, number(limit)) == (word in ("ge", "le")), (name, limit)
            assert taken(cls, kind, name, number(inner)), (name, inner)
