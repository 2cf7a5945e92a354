"""Refines a rough estimate: guess states, fit the physics, fit the pictures."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit.estimator import StateEstimator
from simtune.fit.joint_motion import JointMotion, without_readings
from simtune.fit.latency import clearly_best
from simtune.fit.lateness import Lateness, as_seen
from simtune.fit.observed import Observed
from simtune.fit.offsets import has_unknown_offsets, loosened, without_offsets
from simtune.fit.particles import Particles
from simtune.fit.physics import Physics
from simtune.fit.pictures import PictureFit
from simtune.fit.response import Photometry
from simtune.fit.result import FitResult, Misfit, PointEstimate, block_correlation, diluted
from simtune.fit.shooting import Shooting, ShootingFit
from simtune.fit.shooting_config import ShootingConfig, Stage
from simtune.fit.sizing import FitConfig, FitWork, fit_to_budget
from simtune.fit.window_pictures import fit_window_pictures

_SMALLEST_STD = {"moving": 5e-4, "appearance": 2e-4}  # in unit coordinates: no fit is exact
_FEWEST_TO_FIT = 2  # episodes
_SIDESTEP = (0.01, 0.1)  # bounds of the offset from a start, in unit coordinates
_FARTHEST = 2.0  # cap on the factor by which a long way from the start widens the error
_PARTICLE_STD = (0.02, 0.1)  # bounds of the particles' parameter spread, in unit coordinates
_QUICK_STAGES = Stage(4, 3, 3.0), Stage(12, 4)
_QUICK_WINDOWS = (12, 30)  # bounds


def num_fitted(num_episodes: int) -> int:
    """Episodes fitted: all but the last, kept as a test, if that leaves two or more."""
    return num_episodes - (num_episodes > _FEWEST_TO_FIT)


class Followed(NamedTuple):
    """Result of the particle filter for all episodes."""

    states: np.ndarray  # (E, T + 1, nq + nv)
    start: PointEstimate  # of the fit


class LinedUp(NamedTuple):
    """Episodes with actions shifted to when they take effect, and readings without offsets."""

    observed: Observed
    latency_steps: int  # delay of the actions
    offsets: np.ndarray  # (D,) of all encoders; (0,) if none is unknown
    states: np.ndarray  # as in `Followed`
    start: PointEstimate


class ReplayFit:
    """Fits one simulator to episodes; immutable, so that many worlds are fitted alike."""

    def __init__(
        self,
        physics: Physics,
        estimator: StateEstimator,
        discrepancy_std: np.ndarray,
        config: FitConfig | None = None,
        photometry: Photometry | None = None,
        joints: JointMotion | None = None,
    ):
        """`discrepancy_std`: (N,) in unit coordinates, of errors that no fit can detect.

        `photometry`: prior knowledge of colours; by default none, and the simulator's own camera.
        With `joints` the readings give the robot's motion; `physics` then predicts pictures only.
        """
        self._physics, self._estimator, self._config = physics, estimator, config or FitConfig()
        self._joints = joints
        self._discrepancy_std, self.space = discrepancy_std, physics.parameters
        self._all_moving = np.flatnonzero(~self.space.is_appearance)
        self._moving = np.setdiff1d(self._all_moving, self._config.held)
        self._appearance = np.flatnonzero(self.space.is_appearance)
        self._photometry = photometry or Photometry(None, np.full(len(self.space), np.nan))

    def sized(self, num_steps: int, seconds: float, at_most_s: float) -> "ReplayFit":
        """The same, reduced to take about `seconds`, for episodes of `num_steps` in all.

        See `fit_to_budget`.
        """
        work = FitWork(num_steps, int((self._prior_std > 0).sum()), len(self._moving))
        times = seconds, at_most_s
        return self._with(
            fit_to_budget(self._config, self._physics, self.space.nominal, work, *times)
        )

    def least(self) -> "ReplayFit":
        """The same, as small as a fit may be."""
        return self._with(self._config.least())

    @property
    def is_least(self) -> bool:
        return self._config == self._config.least()

    def _with(self, config: FitConfig) -> "ReplayFit":
        rest = self._discrepancy_std, config, self._photometry, self._joints
        return ReplayFit(self._physics, self._estimator, *rest)

    def fit(
        self,
        observed: Observed,
        start: PointEstimate,
        latencies: Sequence[int] = (0,),
        extend_horizon: bool = True,
    ) -> FitResult:
        """Fit E episodes. If there are three or more, the last one is held out as a test.

        `latencies`: candidate delays of the actions in steps, the usual one first.
        `extend_horizon`: to longer windows if short ones do not tell enough, which takes time.
        Raises OutOfTime; see `within`.
        """
        until_s = time.monotonic() + self._config.longer_within_s
        num, kept = len(observed), num_fitted(len(observed))
        fitted, held_out = slice(0, kept), slice(kept if kept < num else 0, num)
        observed, latency_steps, offsets, states, start = self._line_up(
            observed, fitted, start, latencies
        )
        to_fit = observed.episodes(fitted)
        until_s = until_s if extend_horizon else None
        motion, apart, short = self._fit_motion(to_fit, states[fitted], start, until_s)
        unit = self.space.to_unit(start.parameters)
        unit[self._moving] = motion.unit
        shown = as_seen(self._physics.simulator, short.full_states, short.late_steps)
        pictures = fit_window_pictures(
            self._physics,
            self._prior_std,
            replace(short, full_states=shown),
            to_fit,
            self.space.from_unit(unit),
            self._appearance,
            self._photometry,
            self._config.num_pictures,
        )
        unit[self._appearance] = pictures.unit
        parameters = self.space.from_unit(unit)
        test = self._shooting(self._moving[:0], lateness=observed.lateness).fit(
            observed.episodes(held_out), states[held_out], parameters
        )
        std, correlation = self._claimed(start, motion, apart, pictures)
        return FitResult(
            parameters,
            std,
            self._discrepancy_std,
            correlation,
            self._all_moving,
            Misfit(test.distances, pictures.noise),
            tuple((part.name, part.unit) for part in observed.evidence.parts),
            motion.full_states[0, 0],
            latency_steps,
            np.where(self.space.is_appearance, 0.0, start.std),
            offsets,
            self._appearance[self._photometry.is_known[self._appearance]],
            pictures.responses,
            kept if kept < num else None,
            self._physics.simulator.step_s * np.array([motion.late_steps, motion.late_std]),
        )

    def _claimed(
        self, start: PointEstimate, motion: ShootingFit, apart: np.ndarray, pictures: PictureFit
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N,) standard deviations and (N, N) correlation; held parameters keep their std."""
        std = start.std.copy()
        std[self._moving] = np.hypot(np.sqrt(np.diag(motion.covariance)), apart)
        std[self._appearance] = np.sqrt(np.diag(pictures.covariance))
        kinds = np.where(self.space.is_appearance, "appearance", "moving")
        at_least = np.maximum(std, [_SMALLEST_STD[kind] for kind in kinds])
        blocks = (self._moving, motion.covariance), (self._appearance, pictures.covariance)
        return at_least, diluted(block_correlation(len(std), blocks), std / at_least)

    @property
    def _prior_std(self) -> np.ndarray:
        """(2 nv,) usual errors of first guesses at states; 0: known."""
        usual = self._estimator.prior_std
        return usual if self._joints is None else np.where(self._joints.is_known, 0.0, usual)

    def within(self, budget: Budget) -> "ReplayFit":
        """The same, but raises OutOfTime as soon as `budget` is over."""
        physics = self._physics.within(budget)
        rest = self._discrepancy_std, self._config, self._photometry, self._joints
        return ReplayFit(physics, self._estimator, *rest)

    def _line_up(
        self, observed: Observed, fitted: slice, start: PointEstimate, latencies: Sequence[int]
    ) -> LinedUp:
        """Find the latency of actions, then the encoders' offsets, for which it must be known."""
        if self._joints is not None:
            return self._line_up_by_readings(observed, fitted, start, latencies[0])
        latency_steps, followed = latencies[0], None
        if len(latencies) > 1:
            followed = self._follow(observed.delayed(latency_steps), fitted, start)
            latency_steps = self._find_latency(observed, fitted, followed, latencies)
        observed, offsets = self._find_offsets(observed.delayed(latency_steps), start.parameters)
        if followed is None or latency_steps != latencies[0] or len(offsets):
            followed = self._follow(observed, fitted, start)
        return LinedUp(observed, latency_steps, offsets, *followed)

    def _line_up_by_readings(
        self, observed: Observed, fitted: slice, start: PointEstimate, latency_steps: int
    ) -> LinedUp:
        """The robot's motion is that of the readings; pictures show the rest."""
        assert self._joints is not None
        observed = observed.delayed(latency_steps)
        guessed = self._estimator(observed)
        states, offsets = self._joints.find(observed, guessed, start.parameters)
        observed = without_readings(observed)
        followed = self._follow(observed, fitted, start, states)
        return LinedUp(observed, latency_steps, offsets, *followed)

    def _shooting(
        self,
        fitted: np.ndarray,
        config: ShootingConfig | None = None,
        lateness: Lateness | None = None,
    ) -> Shooting:
        config = config or self._config.shooting
        config = config.where_pictures_are_late() if lateness else config
        return Shooting(self._physics, self._prior_std, fitted, config, lateness)

    def _follow(
        self,
        observed: Observed,
        fitted: slice,
        start: PointEstimate,
        guessed: np.ndarray | None = None,
    ) -> Followed:
        """Follow all episodes; the parameters are estimated from the `fitted` ones.

        `guessed`: (E, T + 1, nq + nv) first guesses at states, by default the estimator's.
        """
        particles = Particles(self._physics, self._prior_std, self._moving, self._config.particles)
        unit, std = self.space.to_unit(start.parameters), start.std.copy()
        guessed = self._estimator(observed) if guessed is None else guessed
        followed = particles.follow(observed, guessed, unit, np.clip(start.std, *_PARTICLE_STD))
        estimates = followed.unit[fitted]
        unit[self._moving] = np.median(estimates, 0)
        if len(estimates) > 1:  # one episode does not show the spread between episodes
            std[self._moving] = estimates.std(0, ddof=1) / np.sqrt(len(estimates))
        return Followed(followed.states, PointEstimate(self.space.from_unit(unit), std))

    def _fit_motion(
        self, observed: Observed, states: np.ndarray, start: PointEstimate, until_s: float | None
    ) -> tuple[ShootingFit, np.ndarray, ShootingFit]:
        """Fit from below and above the start: the middle, and (P,) its estimated error.

        The error is half the distance of the two results, or up to that distance if the middle
        moved farther from the start than the two began. If the horizon is extended from the middle,
        that result replaces it; half of the change counts as an error, too, since longer windows
        may be as biased as the short ones were. `until_s`: see `extend_horizon`; None: no longer
        windows. Also returns the fit of the short windows, whose
        states are closer to the pictures.
        """
        shooting = self._shooting(self._moving, lateness=observed.lateness)
        unit = self.space.to_unit(start.parameters)
        fits, aside = [], np.clip(start.std, *_SIDESTEP)
        for side in (-1, 1):
            begin = unit.copy()
            begin[self._moving] += side * aside[self._moving]
            fits.append(shooting.fit(observed, states, self.space.from_unit(begin)))
        better = min(fits, key=lambda fit: float(np.median(fit.misfit)))
        one, other = (fit.unit for fit in fits)
        middle = replace(better, unit=(one + other) / 2)
        went = np.abs(middle.unit - unit[self._moving]) / aside[self._moving]
        off = np.abs(one - other) / 2 * np.clip(went, 1, _FARTHEST)
        if until_s is not None:
            extended = shooting.extend_horizon(observed, states, start.parameters, middle, until_s)
            if extended is not middle:
                misled = np.abs(extended.unit - middle.unit) / 2
                return extended, np.maximum(misled, off), middle
        return middle, off, middle

    def _find_latency(
        self, observed: Observed, fitted: slice, followed: Followed, latencies: Sequence[int]
    ) -> int:
        """The latency of the actions, in steps, with which the motion fits clearly best.

        Starts from the states `followed` with the first latency: from the estimator's, which are
        less accurate, windows tell little.
        """
        states, parameters = followed.states[fitted], followed.start.parameters
        late = [observed.delayed(steps).episodes(fitted) for steps in latencies]
        misfits = [self._fit_quickly(candidate, states, parameters).misfit for candidate in late]
        return latencies[clearly_best(np.array(misfits))]

    def _find_offsets(
        self, observed: Observed, parameters: np.ndarray
    ) -> tuple[Observed, np.ndarray]:
        """Observations without encoder offsets, and these, (D,) of all joints, from pictures."""
        if not has_unknown_offsets(observed):
            return observed, np.zeros(0)
        loose = loosened(observed)
        fit = self._fit_quickly(loose, self._estimator(loose), parameters)
        unit = self.space.to_unit(parameters)
        unit[self._moving] = fit.unit
        return without_offsets(observed, self._physics, fit, self.space.from_unit(unit))

    def _fit_quickly(
        self, observed: Observed, states: np.ndarray, parameters: np.ndarray
    ) -> ShootingFit:
        num_windows = int(np.clip(self._config.shooting.num_windows, *_QUICK_WINDOWS))
        quick = ShootingConfig(stages=_QUICK_STAGES, num_windows=num_windows)
        return self._shooting(self._moving, quick).fit(observed, states, parameters)
