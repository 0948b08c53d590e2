"""Seeds that only repeat another one: the same frames and the same results of every run.

They are no replicates: where nothing random acts on a deterministic tracker, any number of seeds is one observation,
and would make intervals too narrow and tests too sure.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

MOST_NAMED = 3
"""Most flights that are named."""


@dataclass(frozen=True)
class Observation:
    """A run of a flight under a seed; seen: its frames and numbers in a comparable form, None where unknown."""

    run: str
    flight: str
    seed: int
    seen: str | None


@dataclass(frozen=True)
class Repeats:
    """Groups of seeds by flight; a group counts as one, its first seed."""

    groups: Mapping[str, tuple[tuple[int, ...], ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, observations: Iterable[Observation]) -> "Repeats":
        """The seeds of each flight under which the same was seen in all runs."""
        flights: dict[str, dict[int, dict[str, str | None]]] = {}
        for one in observations:
            flights.setdefault(one.flight, {}).setdefault(one.seed, {})[one.run] = one.seen
        return cls({name: found for name, seeds in flights.items() if (found := tuple(_equal(seeds)))})

    def counts(self, flight: str, seed: int) -> bool:
        """Whether a seed is not a repetition of an earlier one."""
        return not any(seed in group[1:] for group in self.groups.get(flight, ()))

    def __str__(self) -> str:
        """What repeats what and what to do; "" without repeats."""
        named = [f"{name}: seeds {_listed(group)}" for name, groups in self.groups.items() for group in groups]
        more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
        what = "have the same frames and results, and count as one run"
        todo = "keep one seed, or add what seeds change, such as wind or noise"
        return f"{'; '.join(named[:MOST_NAMED])}{more} {what}: {todo}" if named else ""


def _equal(seeds: Mapping[int, Mapping[str, str | None]]) -> Iterable[tuple[int, ...]]:
    groups: dict[frozenset[tuple[str, str | None]], list[int]] = {}
    for seed, seen in sorted(seeds.items()):
        if None not in seen.values():
            groups.setdefault(frozenset(seen.items()), []).append(seed)
    return (tuple(group) for group in groups.values() if len(group) > 1)


def _listed(seeds: tuple[int, ...]) -> str:
    return f"{', '.join(map(str, seeds[:-1]))} and {seeds[-1]}"
