"""Every registered plug-in keeps the same promises."""

import inspect
from dataclasses import FrozenInstanceError, fields, is_dataclass

import pytest
from pydantic import ValidationError

from bench.content import content_hash
from bench.models import build, model_of
from bench.plugins import PLUGINS

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


@pytest.mark.parametrize(("kind", "cls", "verb"), [p for p in ALL if has_defaults(p.values[1])])
def test_numbers_carry_a_range_that_refuses_nonsense(kind, cls, verb):
    for f in fields(cls):
        if isinstance(f.default, float) and not isinstance(f.default, bool):
            with pytest.raises(ValidationError):
                model_of(cls, (), kind).model_validate_json(f'{{"kind": "{kind}", "{f.name}": NaN}}')
