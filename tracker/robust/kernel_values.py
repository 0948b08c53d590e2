"""Config values as compiled kernels take them: arguments, so that another value needs no recompilation.

A stage's config is a frozen dataclass, which numba does not know. Its numbers become a named tuple of the same field
names; kernels are written against the dataclass, so that mypy checks their use of it.
"""

import sys
from collections import namedtuple
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar, cast, get_type_hints

from uavbench.trajectories.kernels.argument_types import named_tuple

T = TypeVar("T")
WORDS = {float: "f0", int: "i0"}
PLAIN = {word: plain for plain, word in WORDS.items()}
"""An int where a float is due is a mistake that Python forgives and numba does not."""


def kernel_values(config: T) -> T:
    """The numbers of a stage's config as a named tuple, which replaces the config in kernels."""
    of: type = type(config)
    numbers = {name: PLAIN[word](getattr(config, name)) for name, word in _numbers(of).items()}
    return cast(T, values_class(of)(**numbers))


def kernel_type(config: type) -> Any:
    """Numba's type of what `kernel_values` makes of a config of this class."""
    return named_tuple(values_class(config), " ".join(_numbers(config).values()))


@cache
def values_class(config: type) -> Any:
    """Named tuple of the numbers of a config class; it lies beside the class, where pickled kernels look for it."""
    name = f"{config.__name__}Values"
    made: Any = namedtuple(name, _numbers(config), module=config.__module__)  # type: ignore[misc]
    setattr(sys.modules[config.__module__], name, made)
    return made


def _numbers(config: type) -> dict[str, str]:
    """Names of the numbers among the fields of a config class, with their words in a kernel's declaration."""
    hints = get_type_hints(config)
    return {f.name: WORDS[hints[f.name]] for f in fields(config) if hints[f.name] in WORDS}
