"""Settings of multiple shooting, and how many steps it plays with them."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

DERIVED_EVERY = 3  # iterations (the chord method): derivatives cost most, and change slowly
_LATE_BLUR = 3.0
_LAST_PRIOR_FACTOR = 10.0
_TRIED_WORLDS = 2  # per iteration, to check whether its step lowers the cost


class Stage(NamedTuple):
    window: int  # steps
    iterations: int
    blur: float = 1.0  # factor on the noise
    states_only: bool = False  # parameters stay as they are

    @property
    def prior_factor(self) -> float:
        """On the standard deviation of first guesses at states."""
        # Without blur first guesses count little: they come from worlds with other parameters, so
        # they pull the parameters towards these, and make the fit too certain.
        return _LAST_PRIOR_FACTOR if self.blur <= 1 else 1.0


class Spans(NamedTuple):
    """Steps of the finite differences."""

    state: float = 0.03  # in the standard deviation of first guesses
    unit: float = 0.5  # of parameters, in the standard deviation between windows


@dataclass(frozen=True, kw_only=True)
class ShootingConfig:
    # First short and blurred, to bring the states near from far away.
    stages: tuple[Stage, ...] = (
        Stage(4, 6, 6.0, states_only=True),
        Stage(8, 3, 2.0),
        Stage(12, 6),
    )
    # Windows of about so many steps (see `even_length`), if short ones do not tell enough
    longer: tuple[int, ...] = (24, 48, 96)
    longer_iterations: int = 5  # blurred, and as many that are not
    num_windows: int = 90  # at most, spread evenly; fewer longer ones, with as many steps
    spans: Spans = field(default_factory=Spans)

    def where_joints_are_known(self) -> "ShootingConfig":
        """Long windows at once, since only objects may go astray in them.

        What pushes them makes their motion rough: slopes across a short span are noise. In seven
        worlds of a pusher and a box, friction was off by .019 on average, before by .054, in unit
        coordinates; with ALOHA's arms a box's friction by .009, before by .03.
        """
        return replace(
            self,
            stages=(Stage(12, 3, 6.0, states_only=True), Stage(25, 6, 3.0), Stage(50, 8)),
            longer=(),
            num_windows=self.num_windows // 3,
            spans=Spans(state=0.3, unit=4.0),
        )

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
    return num_derived * -(-iterations // DERIVED_EVERY) + _TRIED_WORLDS * iterations
