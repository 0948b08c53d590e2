"""Variants of a tracker: each number of its config scaled, one at a time, within its bounds."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, get_args, get_origin, get_type_hints

Number = float | int | tuple[float | int, ...]


@dataclass(frozen=True)
class Value:
    """A number of a config, or a tuple of numbers scaled together: its dotted path, default and limits."""

    path: str
    default: Number
    limits: tuple[Any, ...]

    def scaled(self, factor: float) -> Number | None:
        """The default times a factor, clipped to its bounds; None when that has no effect or is not allowed."""
        if isinstance(self.default, tuple):
            each = [_within(_times(number, factor), self.limits) for number in self.default]
            made: Number | None = None if None in each else tuple(n for n in each if n is not None)
        else:
            made = _within(_times(self.default, factor), self.limits)
        return None if made == self.default else made


def values_of(tracker: Any, at: str = "") -> Iterator[Value]:
    """Every number of a dataclass and of the dataclasses in it, with its limits as annotated."""
    hints = get_type_hints(type(tracker), include_extras=True)
    for f in fields(tracker):
        given, path = getattr(tracker, f.name), f"{at}{f.name}"
        if is_dataclass(given) and not isinstance(given, type):
            yield from values_of(given, f"{path}.")
        elif _is_number(given) or (isinstance(given, tuple) and given and all(map(_is_number, given))):
            yield Value(path, given, _limits(hints[f.name]))


def changed(tracker: Any, path: str, value: Number) -> Any:
    """The tracker with one value of its config replaced."""
    name, _, below = path.partition(".")
    return replace(tracker, **{name: changed(getattr(tracker, name), below, value) if below else value})


def _is_number(given: Any) -> bool:
    return isinstance(given, float | int) and not isinstance(given, bool)


def _times(number: float, factor: float) -> float | int:
    """A number times a factor; integers are rounded."""
    return round(number * factor) if isinstance(number, int) else number * factor


def _limits(hint: Any) -> tuple[Any, ...]:
    """Limits that an annotation sets for a number, or for each element of a tuple."""
    limits: tuple[Any, ...] = ()
    while get_origin(hint) in (Annotated, tuple):
        if get_origin(hint) is Annotated:
            limits += get_args(hint)[1:]
        hint = get_args(hint)[0]
    return limits


def _within(number: float, limits: tuple[Any, ...]) -> float | int | None:
    """The number clipped to inclusive bounds; None if it violates an exclusive one."""
    for limit in limits:
        least, most = getattr(limit, "ge", None), getattr(limit, "le", None)
        above, below = getattr(limit, "gt", None), getattr(limit, "lt", None)
        if (above is not None and not number > above) or (below is not None and not number < below):
            return None
        number = number if least is None else max(number, type(number)(least))
        number = number if most is None else min(number, type(number)(most))
    return number
