"""Settings of multiple shooting, and how many steps it plays with them."""

from dataclasses import dataclass, replace
from typing import NamedTuple

DERIVED_EVERY = 3  # iterations (the chord method): derivatives cost most, and change slowly
_LATE_BLUR = 3.0
_TRIED = 2  # worlds per iteration, to check whether its step lowers the cost


class Stage(NamedTuple):
    window: int  # steps
    iterations: int
    blur: float = 1.0  # factor on the noise


@dataclass(frozen=True, kw_only=True)
class ShootingConfig:
    # First short and blurred, to bring the states near from far away.
    stages: tuple[Stage, ...] = (Stage(4, 6, 6.0), Stage(8, 3, 2.0), Stage(12, 6))
    # Windows of about so many steps (see `even_length`), if short ones do not tell enough
    longer: tuple[int, ...] = (24, 48, 96)
    longer_iterations: int = 5  # blurred, and as many that are not
    num_windows: int = 90  # at most, spread evenly; fewer longer ones, with as many steps

    def where_pictures_are_late(self) -> "ShootingConfig":
        """Blurred for longer, to fit lateness: at first it shows in what looks like outliers."""
        first, *between, last = self.stages
        blurred = [Stage(last.window, stage.iterations, _LATE_BLUR) for stage in between]
        return replace(self, stages=(first, *blurred, last))

    def steps_per_window(self, num_derived: int) -> int:
        """Steps that a fit plays per window, with `num_derived` worlds for derivatives."""
        return sum(s.window * _worlds(s.iterations, num_derived) for s in self.stages)

    def steps_of_longer(self, num_derived: int) -> int:
        """The same for the first longer windows, which are always tried; others are rare."""
        worlds = _worlds(self.longer_iterations, num_derived)
        return 2 * self.stages[-1].window * worlds * bool(self.longer)


def _worlds(iterations: int, num_derived: int) -> int:
    """Worlds that play each window in `iterations` iterations."""
    return num_derived * -(-iterations // DERIVED_EVERY) + _TRIED * iterations
