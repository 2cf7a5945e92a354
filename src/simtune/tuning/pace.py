"""Predicts how long a round takes on this machine, from measurements of a second or two.

A round's work is counted in four units, each timed once: a world's policy step, a picture drawn, a
picture detected, an update of the detector.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from simtune.budget import timed
from simtune.columns import two_digits
from simtune.fit import FEW_EPISODES, FitWork, count_fit_steps
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.simulation import AnySimulator
from simtune.trajectory import Trajectory
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import SearchContext

T = TypeVar("T")

MOST_REPLAYED = 4  # episodes, by a check: any others are assumed to tell as much
_TIMED_WORLDS, _TIMED_STEPS, _TIMED_UPDATES = 32, 20, 3
_SMALL_UPDATE_RATIO = 0.7  # of another network's update to one of the detector
_UNCOUNTED_FACTOR = 1.3  # for all that is not counted, as latencies that are tried
_READINGS_TIME_RATIO = 2.0  # of a check's time for readings to that for pictures: 1.8 of two arms
_DRAWINGS_PER_PICTURE = 60  # in a fit to pixels
_FEWEST_REFITS = 2
_FEWEST_WORLDS = 64  # fewer teach a network nothing
# What makes them cheaper, in messages
_CHEAPER_PHYSICS = (
    "a longer physics timestep, fewer contacts, joints that stand still as fixed_joints"
)
_CHEAPER_STEP = "a cheaper step() of the environment"
_CHEAPER_SCENE = "simpler meshes, fewer cameras or a smaller --image-size"
_CHEAPER_RENDER = (
    "the environment's own render() without shadows, reflections and multisampling, and of hardly "
    "more pixels than --image-size,"
)


class Work(NamedTuple):
    """Size of a round's work, given the scene and its recordings."""

    num_episodes: int
    num_steps: int  # of each
    num_tangent: int  # 2 nv, of a fitted state; 0: nothing can be fitted
    num_fitted: int  # parameters that affect motion
    fits_pixels: bool = False  # colours, light and the like
    supersampling: int = 1  # divides the number of pictures drawn, since each takes longer
    is_environment: bool = False  # which steps and draws by itself

    @classmethod
    def of(cls, simulator: AnySimulator, real: list[Trajectory], is_fitted: bool) -> "Work":
        space = simulator.state_space if is_fitted else None
        looks = simulator.space.is_appearance
        num_tangent = space.num_tangent if space else 0
        steps, is_environment = min(len(t) for t in real), simulator.state_space is None
        shape = len(real), steps, num_tangent, int((~looks).sum()), bool(looks.any())
        return cls(*shape, simulator.supersampling, is_environment)


@dataclass(frozen=True)
class Pace:
    """Seconds per unit of work, under the machine's present load."""

    step_s: float  # a world's policy step, in a large batch
    frame_s: float  # drawing a picture
    detect_s: float  # detecting in a picture
    update_s: float  # an update of the detector

    @classmethod
    def measure(
        cls, context: SearchContext, model: PosteriorSearchParamModel, distribution: Distribution
    ) -> "Pace":
        """Time a little of each, in worlds of `distribution`."""
        simulator, rng = context.simulator, stream(context.seed, Purpose.PACE)
        worlds = distribution.sample(_TIMED_WORLDS, rng)
        act = simulator.explore(_TIMED_WORLDS, _TIMED_STEPS, rng)
        step_s, played = _timed_again(lambda: simulator.play(worlds, act, _TIMED_STEPS, rng))
        last = played.states[:, -1]
        frame_s, frames = _timed_again(lambda: simulator.render(last, worlds))
        detect_s, _ = _timed_again(lambda: model.detect(frames))
        update_s, _ = _timed_again(lambda: model.time_updates(frames, _TIMED_UPDATES))
        return cls(
            step_s / (_TIMED_WORLDS * _TIMED_STEPS),
            frame_s / _TIMED_WORLDS,
            detect_s / _TIMED_WORLDS,
            update_s / _TIMED_UPDATES,
        )

    def round_s(self, config: PosteriorSearchConfig, work: Work) -> float:
        """Approximate seconds of a first round with these settings."""
        return sum(self._parts_s(config, work))

    def check_s(self, work: Work, reads: bool) -> float:
        """Approximate seconds of what `simtune check` would say; `reads`: of readings, too."""
        played = min(MOST_REPLAYED, work.num_episodes) * work.num_steps
        # Each parameter changes once, and derivatives are by all parameters and states
        changed = 2 + 2 * work.num_fitted + work.num_tangent
        return self.step_s * played * changed * (1 + _READINGS_TIME_RATIO * reads)

    def mostly(self, config: PosteriorSearchConfig, work: Work) -> str:
        """What takes most of such a round, and what would help."""
        parts_s = self._parts_s(config, work)
        most, share = int(np.argmax(parts_s)), max(parts_s) / sum(parts_s)
        if most == 0:
            return slow_steps(share, self.step_s, is_environment=work.is_environment)
        if most == 1:
            helps = _CHEAPER_RENDER if work.is_environment else _CHEAPER_SCENE
            return (
                f"Pictures take {share:.0%} of that, {_ms(self.frame_s)} each to draw and "
                f"{_ms(self.detect_s)} to look at: {helps} would help"
            )
        return (
            f"Training networks takes {share:.0%} of that: more cores, or a smaller --image-size, "
            "would help"
        )

    def _parts_s(self, config: PosteriorSearchConfig, work: Work) -> tuple[float, float, float]:
        """Of simulated steps, of pictures, and of training."""
        episodes, steps = work.num_episodes, work.num_steps
        worlds_s = self.step_s * steps * min(config.episodes_per_world, episodes)  # per world
        num_near = config.near_worlds if work.num_tangent else 0
        tested = config.held_out_worlds * config.held_out_steps + num_near * config.near_steps
        drawn = (config.num_worlds * config.pictures_per_world + tested) / work.supersampling
        played_s = config.num_worlds * worlds_s
        played_s += (config.held_out_worlds + num_near) * self.step_s * steps
        pictures_s = self.frame_s * drawn + self.detect_s * tested / work.supersampling
        pictures_s += self.detect_s * episodes * (steps + 1)  # the real ones
        trained_s = self.update_s * config.detector_updates[0]
        small_s = _SMALL_UPDATE_RATIO * self.update_s
        if not work.num_tangent:
            played_s += config.no_fit_scale * config.num_worlds * worlds_s
            trained_s += config.no_fit_scale * small_s * config.posterior_updates
            return played_s, pictures_s, trained_s
        trained_s += small_s * (config.posterior_updates + config.state_updates)
        fitted = FitWork(episodes * steps, work.num_tangent, work.num_fitted)
        few = min(FEW_EPISODES, episodes)
        refitted = fitted._replace(num_steps=few * steps)
        pictures_s += config.planned_refits * few * (steps + 1) * (self.frame_s + self.detect_s)
        fits_s = (1 + config.planned_refits) * config.fit.num_pictures * self.frame_s
        pictures_s += _DRAWINGS_PER_PICTURE * work.fits_pixels * fits_s
        played = sum(count_fit_steps(config.fit, fitted))
        played_again = sum(count_fit_steps(config.fit, refitted))
        played += config.planned_refits * played_again
        return played_s + _UNCOUNTED_FACTOR * self.step_s * played, pictures_s, trained_s


def slow_steps(share: float, step_s: float, *, is_environment: bool = False) -> str:
    """What to say if simulated steps take so much of a search, and each so long."""
    return (
        f"Simulating takes {share:.0%} of that, {_ms(step_s)} for each step of an action: "
        f"{_CHEAPER_STEP if is_environment else _CHEAPER_PHYSICS}, or fewer or shorter episodes "
        "would help"
    )


def _ms(seconds: float) -> str:
    return f"{two_digits(1e3 * seconds)} ms"


def smallest(config: PosteriorSearchConfig) -> PosteriorSearchConfig:
    """The smallest sound round: with less, networks are confidently wrong."""
    least = config.least_updates
    return replace(
        config,
        num_worlds=min(_FEWEST_WORLDS, config.num_worlds),
        held_out_worlds=min(_FEWEST_WORLDS, config.held_out_worlds),
        detector_updates=(min(least, config.detector_updates[0]),),
        posterior_updates=min(least, config.posterior_updates),
        state_updates=min(least, config.state_updates),
        planned_refits=min(_FEWEST_REFITS, config.planned_refits),
        no_fit_scale=1,
        fit=config.fit.least(),
    )


def _timed_again(work: Callable[[], T]) -> tuple[float, T]:
    """The second call: one-time work of the first is not counted."""
    work()
    seconds, done = timed(work)
    return max(1e-9, seconds), done
