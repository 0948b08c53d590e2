"""Config values as arguments of compiled kernels, so that changing a value needs no recompilation.

A stage's config is a frozen dataclass, which numba does not support. Its numbers become a named tuple with the same
field names; kernels are annotated with the dataclass, so that mypy checks their use of it.
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
"""Word of a kernel's declaration -> Python type, to which values are converted: numba takes no int for a float."""


def kernel_values(config: T) -> T:
    """The numbers of a stage's config as a named tuple, which takes the place of the config in kernels."""
    of: type = type(config)
    numbers = {name: PLAIN[word](getattr(config, name)) for name, word in _numbers(of).items()}
    return cast(T, values_class(of)(**numbers))


def kernel_type(config: type) -> Any:
    """Numba's type of the result of `kernel_values` for this config class."""
    return named_tuple(values_class(config), " ".join(_numbers(config).values()))


@cache
def values_class(config: type) -> Any:
    """Named tuple of the numbers of a config class, stored in its module, where unpickled kernels look it up."""
    name = f"{config.__name__}Values"
    made: Any = namedtuple(name, _numbers(config), module=config.__module__)  # type: ignore[misc]
    setattr(sys.modules[config.__module__], name, made)
    return made


def _numbers(config: type) -> dict[str, str]:
    """Names of the numbers among the fields of a config class, with their words in a kernel's declaration."""
    hints = get_type_hints(config)
    return {f.name: WORDS[hints[f.name]] for f in fields(config) if hints[f.name] in WORDS}
