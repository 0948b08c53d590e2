"""The work of a frame, counted in evaluations instead of milliseconds, and thus equal on all machines."""

from dataclasses import dataclass


@dataclass
class Work:
    """Evaluations (edge points looked up in an image) allowed for a frame, and spent so far."""

    allowed: int
    done: int = 0

    @property
    def left(self) -> int:
        """Evaluations left; negative if the budget was exceeded."""
        return self.allowed - self.done
