"""Refines a rough estimate: guess states, fit the physics, fit the pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from simtune.budget import Budget
from simtune.fit.fit_setup import FitSetup
from simtune.fit.lateness import PICTURES, is_too_late, states_in_late_pictures
from simtune.fit.line_up import LinedUp, line_up
from simtune.fit.misread_actions import misread_actions
from simtune.fit.motion.shooting import ShootingFit
from simtune.fit.motion.two_sides import TwoSidedFit, fit_from_two_sides
from simtune.fit.observed import Observed, Split
from simtune.fit.pictures.picture_fit import PictureFit
from simtune.fit.pictures.response import Photometry
from simtune.fit.pictures.window_pictures import fit_window_pictures
from simtune.fit.result import FitResult, Misfit, PointEstimate, block_correlation, diluted
from simtune.fit.sizing import fit_to_budget

# In unit coordinates: no fit is exact
_SMALLEST_STD, _SMALLEST_APPEARANCE_STD = 5e-4, 2e-4


@dataclass(frozen=True, kw_only=True)
class ReplayFit(FitSetup):
    """Fits one simulator to episodes; immutable, so that many worlds are fitted alike.

    With `joints` the readings give the robot's motion; `physics` then predicts pictures only.
    """

    discrepancy_std: np.ndarray  # (N,) in unit coordinates, of errors that no fit can detect
    photometry: Photometry  # prior knowledge of colours

    @cached_property
    def appearance(self) -> np.ndarray:
        """(V,) indices of the parameters that only pictures show."""
        return np.flatnonzero(self.space.is_appearance)

    def sized(self, num_steps: int, seconds: float, at_most_s: float) -> "ReplayFit":
        """The same, reduced to take about `seconds`, for episodes of `num_steps` in all.

        See `fit_to_budget`.
        """
        work, nominal = self.work(num_steps), self.space.nominal
        config = fit_to_budget(self.config, self.physics, nominal, work, seconds, at_most_s)
        return replace(self, config=config)

    def least(self) -> "ReplayFit":
        """The same, as small as a fit may be."""
        return replace(self, config=self.config.least())

    @property
    def is_least(self) -> bool:
        return self.config == self.config.least()

    def within(self, budget: Budget) -> "ReplayFit":
        """The same, but raises OutOfTime as soon as `budget` is over."""
        return replace(self, physics=self.physics.within(budget))

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
        split = Split.of(len(observed))
        longer_within = Budget(self.config.longer_within_s) if extend_horizon else None
        lined_up = line_up(self, observed, split.fitted, start, latencies)
        motion = self._fit_motion(lined_up, split.fitted, longer_within)
        unit = self.space.to_unit(lined_up.start.parameters)
        unit[self.moving] = motion.best.unit
        to_fit = lined_up.observed.episodes(split.fitted)
        pictures = self._fit_pictures(to_fit, motion.short, self.space.from_unit(unit))
        unit[self.appearance] = pictures.unit
        return self._result(unit, lined_up, motion, pictures, split)

    def misread_actions(
        self, observed: Observed, start: PointEstimate, latencies: Sequence[int]
    ) -> list[str]:
        """See there; none where readings tell a robot's motion, whatever its actions are."""
        if self.joints is not None:
            return []
        fitted = observed.episodes(Split.of(len(observed)).fitted)
        return misread_actions(self, fitted, start.parameters, latencies)

    def _fit_motion(
        self, lined_up: LinedUp, fitted: slice, longer_within: Budget | None
    ) -> TwoSidedFit:
        """Fit what moves to the fitted episodes, and to longer windows if there is time for it."""
        observed = lined_up.observed
        return fit_from_two_sides(
            self.shooting(self.moving, lateness=observed.lateness),
            self.space,
            observed.episodes(fitted),
            lined_up.states[fitted],
            lined_up.start,
            longer_within,
        )

    def _fit_pictures(
        self, observed: Observed, motion: ShootingFit, parameters: np.ndarray
    ) -> PictureFit:
        """Fit what pictures show besides motion, in the states in which they were taken."""
        if not len(self.appearance):
            return PictureFit.of_nothing()  # without drawing a thousand pictures for it
        simulator = self.physics.simulator
        late_steps, _ = motion.late.get(PICTURES, (0.0, 0.0))
        seen = states_in_late_pictures(simulator, motion.full_states, late_steps)
        return fit_window_pictures(
            self,
            replace(motion, full_states=seen),
            observed,
            parameters,
            self.appearance,
            self.photometry,
        )

    def _result(
        self,
        unit: np.ndarray,
        lined_up: LinedUp,
        motion: TwoSidedFit,
        pictures: PictureFit,
        split: Split,
    ) -> FitResult:
        """What was found, in (N,) unit coordinates, tested on the episode held out."""
        observed, best = lined_up.observed, motion.best
        parameters, step_s = self.space.from_unit(unit), self.physics.simulator.step_s
        test = self.shooting(self.moving[:0], lateness=observed.lateness).fit(
            observed.episodes(split.tested), lined_up.states[split.tested], parameters
        )
        std, correlation = self._claimed(lined_up.start, motion, pictures)
        known = self.appearance[self.photometry.is_known[self.appearance]]
        return FitResult(
            parameters=parameters,
            std=std,
            discrepancy_std=self.discrepancy_std,
            correlation=correlation,
            is_moving=~self.space.is_appearance,
            misfit=Misfit(test.distances, tuple(pictures.noise.tolist())),
            sensors=tuple((part.name, part.unit) for part in observed.evidence.parts),
            starts=self._starts(lined_up, unit, (best, split.fitted), (test, split.tested)),
            latency_steps=lined_up.latency_steps,
            rough_std=np.where(self.space.is_appearance, 0.0, lined_up.start.std),
            offsets=lined_up.offsets,
            known=known,
            responses=pictures.responses,
            unusual_camera=self.photometry.unusual(pictures.responses) if known.size else None,
            held_out=split.held_out,
            late_s={k: (step_s * late, step_s * error) for k, (late, error) in best.late.items()},
            is_too_late=any(is_too_late(late) for late, _ in best.late.values()),
            beside=best.beside,
            held=np.array(self.config.held, int),
        )

    def _claimed(
        self, start: PointEstimate, motion: TwoSidedFit, pictures: PictureFit
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N,) standard deviations and (N, N) correlation; held parameters keep their std."""
        std = start.std.copy()
        covariance = motion.covariance
        std[self.moving] = np.sqrt(np.diag(covariance))
        std[self.appearance] = np.sqrt(np.diag(pictures.covariance))
        smallest = np.where(self.space.is_appearance, _SMALLEST_APPEARANCE_STD, _SMALLEST_STD)
        at_least = np.maximum(std, smallest)
        blocks = (self.moving, covariance), (self.appearance, pictures.covariance)
        return at_least, diluted(block_correlation(len(std), blocks), std / at_least)

    def _starts(
        self, lined_up: LinedUp, unit: np.ndarray, *fits: tuple[ShootingFit, slice]
    ) -> np.ndarray:
        """(E, S) full states in which episodes begin: as fitted, or else as `lined_up` says.

        Each fit is of some of the episodes; `unit`: the (N,) parameters found.
        """
        physics, states = self.physics, lined_up.states
        first_actions = lined_up.observed.actions[:, :1]
        begun = physics.replay_actuators(first_actions, states[:, :2], unit)[:, 0]  # before any
        starts = physics.space.with_positions_and_velocities(begun, states[:, 0])
        for fit, episodes in fits:
            begins = fit.step == 0
            starts[episodes][fit.episode[begins]] = fit.full_states[begins, 0]
        return starts
