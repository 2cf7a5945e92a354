"""The settings of multiple shooting, and how much is played with them."""

from dataclasses import dataclass, replace
from typing import NamedTuple

DERIVED_EVERY = 3  # iterations (the chord method): derivatives cost most, and change slowly
_LATE_BLUR = 3.0
_TRIED = 2  # worlds, with which it is seen whether a step is one for the better


class Stage(NamedTuple):
    window: int  # steps
    iterations: int
    blur: float = 1.0  # a factor on the noise


@dataclass(frozen=True, kw_only=True)
class ShootingConfig:
    # Short and blurred first, which brings the states near from far away.
    stages: tuple[Stage, ...] = (Stage(4, 6, 6.0), Stage(8, 3, 2.0), Stage(12, 6))
    longer: tuple[int, ...] = (24, 48, 96)  # windows, where those do not tell enough
    longer_iterations: int = 5  # blurred, and as many that are not
    num_windows: int = 90  # at most; spread evenly. Of longer ones fewer: as many steps in all

    def where_pictures_are_late(self) -> "ShootingConfig":
        """By a time that is fitted, too: what stands out far is what tells of that at first."""
        first, *between, last = self.stages
        blurred = [Stage(last.window, stage.iterations, _LATE_BLUR) for stage in between]
        return replace(self, stages=(first, *blurred, last))

    def steps_per_window(self, num_derived: int) -> int:
        """Steps that a fit plays of each of these windows, where it derives by so many worlds."""
        return sum(s.window * _worlds(s.iterations, num_derived) for s in self.stages)

    def steps_of_longer(self, num_derived: int) -> int:
        """The same of the first longer windows, which are always tried; others are rare."""
        each = _worlds(self.longer_iterations, num_derived)
        return 2 * self.stages[-1].window * each * bool(self.longer)


def _worlds(iterations: int, num_derived: int) -> int:
    """That play each window in so many iterations."""
    return num_derived * -(-iterations // DERIVED_EVERY) + _TRIED * iterations
