"""The work of a frame, counted in evaluations and not in milliseconds: the same on every machine."""

from dataclasses import dataclass


@dataclass
class Work:
    """Evaluations (edge points looked up in an image) that a frame is allowed, and that it has done."""

    allowed: int
    done: int = 0

    @property
    def left(self) -> int:
        """Evaluations left; negative where more was done than allowed."""
        return self.allowed - self.done
