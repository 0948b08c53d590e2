"""A shard of a suite: every N-th sequence from the i-th on, for machines that share only a folder."""

from dataclasses import dataclass, replace

from uavbench.bench.config.suite import Suite
from uavbench.trajectories.errors import UserError


@dataclass(frozen=True)
class Shard:
    """Part `number` (from 1) of `count`."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Parse `i/N`; UserError for any other text."""
        first, slash, second = text.partition("/")
        if not (slash and first.isdecimal() and second.isdecimal() and 1 <= int(first) <= int(second)):
            raise UserError(f"--shard {text}: write i/N with i from 1 to N, for example 3/8")
        return cls(int(first), int(second))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, suite: Suite) -> Suite:
        """The suite with only the sequences of this shard."""
        return replace(suite, sequences=suite.sequences[self.number - 1 :: self.count])
