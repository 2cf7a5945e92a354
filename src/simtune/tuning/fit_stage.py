"""Last stage of a round: fit the simulator to the observations, and judge the fit by refits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit import (
    PICTURES,
    FitResult,
    Lateness,
    Observed,
    Photometry,
    Physics,
    PointEstimate,
    Refits,
    ReplayFit,
    StateEstimator,
    run_bootstrap,
    states_in_late_pictures,
)
from simtune.networks.training import TrainingClock
from simtune.observation import AllEvidence, JointReadings
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.detected import HeldOut
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.readings.estimate import ReadingsEstimate
from simtune.tuning.rounds import TRAIN_ESTIMATOR
from simtune.tuning.search import SearchContext
from simtune.vision.detections import Detections
from simtune.vision.detector_noise import DetectorNoise
from simtune.vision.keypoint_tracks import KeypointTracks

# Factor on the readings' noise in windows, if they cannot be replayed alone. They are far sharper
# than pictures, and contacts make the motion rough: at full weight no step of a fit lowers the
# cost, and hardly any particle survives. In five worlds of a walker (readings of .001 rad), fits
# from below and above end .008 apart in a mass's unit coordinate at ten times the noise, .005 at
# thirty and at a hundred.
_NOISE_INFLATION = 30.0


class RefitPlan(NamedTuple):
    """How many known worlds to begin to fit, and the first episodes of each that are played."""

    num_worlds: int
    num_episodes: int


@dataclass(frozen=True)
class FitStage:
    """A fit with the detector's noise and a state estimator; it treats all worlds alike."""

    context: SearchContext
    model: PosteriorSearchParamModel
    replay_fit: ReplayFit
    noise: DetectorNoise
    learnt_from: AllEvidence  # by the state estimator: on its scale readings are given to it
    inflates_noise: bool = False  # of readings, see `_NOISE_INFLATION`

    @classmethod
    def prepare(
        cls,
        context: SearchContext,
        model: PosteriorSearchParamModel,
        held_out: HeldOut,
        near: HeldOut,
        config: PosteriorSearchConfig,
        budget: Budget,
        by_readings: ReadingsEstimate | None = None,
    ) -> "FitStage":
        """Train the state estimator in held-out worlds.

        The detector's noise is measured in those `near` the real one. `by_readings`: None if they
        are used in windows only, or there are none.
        """
        observe, joints = context.keypoints.observe, by_readings.joints if by_readings else None
        if not joints:
            observe = context.observation.observe_beside(observe)
        worlds, observed = held_out.worlds, _as_observed(context, held_out)
        physics = Physics(_simulator_of(context), observe, worlds.states[0, 0])
        part = budget.share(config.state_share, TRAIN_ESTIMATOR)
        clock = TrainingClock(
            config.state_updates, part, "learning to guess states", config.least_updates
        )
        estimator = StateEstimator.train(
            observed,
            physics.states(worlds.states),
            physics.space,
            physics.simulator.action_scale,
            context.seed,
            clock,
        )
        discrepancy, photometry = _appearance(context)
        replay_fit = ReplayFit(physics, estimator, discrepancy, config.fit, photometry, joints)
        learnt_from = observed.evidence.at(np.arange(0))  # its scales only
        inflates_noise = by_readings is None
        return cls(context, model, replay_fit, near.noise(), learnt_from, inflates_noise)

    @property
    def reading_labels(self) -> tuple[str, ...]:
        """Labels of the fits' offsets."""
        return self.context.observation.reading_labels

    def sized(self, num_steps: int, seconds: float, at_most_s: float) -> "FitStage":
        """The same, with fits that take about `seconds`, for real episodes of `num_steps` in all.

        See `fit_to_budget`.
        """
        return replace(self, replay_fit=self.replay_fit.sized(num_steps, seconds, at_most_s))

    def least(self) -> "FitStage":
        """The same, with fits as small as they may be."""
        return replace(self, replay_fit=self.replay_fit.least())

    @property
    def is_least(self) -> bool:
        return self.replay_fit.is_least

    @property
    def _simulator(self) -> Simulator:
        return _simulator_of(self.context)

    def observed(
        self, trajectories: Sequence[Trajectory], detections: Sequence[Detections]
    ) -> Observed:
        """Episodes cut to equal length, with the detections in their frames."""
        steps = min(len(t) for t in trajectories)
        cut = [found.first(steps + 1) for found in detections]
        tracks = KeypointTracks.of_detections(cut, self._simulator.shape, self.noise)
        first = [t.first(steps) for t in trajectories]
        names = first[0].readings
        readings = {name: np.stack([t.readings[name] for t in first]) for name in names}
        evidence = self.context.observation.evidence(tracks, readings)
        evidence = _scaled_as(evidence, self.learnt_from)
        if self.inflates_noise:
            evidence = _with_inflated_noise(evidence)
        actions = np.stack([t.actions for t in first]).astype(float)
        frames = [t.frames for t in first]  # views, not copies: there may be many
        return Observed(evidence, actions, frames, self._lateness(evidence))

    def _lateness(self, evidence: AllEvidence) -> Lateness | None:
        """What may be late by a part of a step."""
        substeps = self._simulator.num_substeps
        if self._max_latency_steps:
            return Lateness.of_evidence(evidence, substeps)
        # A declared delay is of actions: beside readings, pictures tell how late the camera is
        observation, is_declared = self.context.observation, self._simulator.space.is_delay.any()
        if is_declared and observation.max_latency_steps and observation.sensors:
            return Lateness.of_evidence(evidence, substeps, [PICTURES])
        return None

    @property
    def _max_latency_steps(self) -> int:
        return self.context.observation.unknown_latency_steps(self._simulator)

    def fit(
        self,
        observed: Observed,
        start: PointEstimate,
        extend_horizon: bool,
        finds_latency: bool,
        budget: Budget,
    ) -> FitResult:
        """See `ReplayFit.fit`; `finds_latency`: of the actions, if there may be one.

        Raises OutOfTime as soon as `budget` is over.
        """
        most = self._max_latency_steps if finds_latency else 0
        replay_fit = self.replay_fit.within(budget)
        return replay_fit.fit(observed, start, range(most + 1), extend_horizon)

    def refit(
        self,
        observed: Observed,
        fit: FitResult,
        start: PointEstimate,
        plan: RefitPlan,
        rng: np.random.Generator,
        extend_horizon: bool,
        budget: Budget,
    ) -> Refits:
        """Film and fit known worlds near `fit`, which begin as it does and play the same actions.

        Fewer worlds than planned if `budget` is over before: an unfinished refit does not count.
        """
        actions, observation = observed.actions[: plan.num_episodes], self.context.observation
        # What an action moves depends on where objects stand. With the box elsewhere, actions that
        # had moved ALOHA's real box moved nothing.
        starts = fit.starts[: plan.num_episodes]

        def synthesize(parameters: np.ndarray, latency_steps: int) -> Observed | None:
            worlds = np.repeat(parameters[None], len(actions), 0)
            played, see = delayed(actions, latency_steps), observation.observe_beside()
            rollouts = self._simulator.roll_out(worlds, played, rng, see, starts)
            if len(rollouts) < len(actions):
                return None
            shown = states_in_late_pictures(
                self._simulator, rollouts.states, fit.pictures_late_s[0] / self._simulator.step_s
            )
            recorded = observation.record(self._simulator, replace(rollouts, states=shown), rng)
            detections = [self.model.detect(trajectory.frames) for trajectory in recorded]
            return replace(self.observed(recorded, detections), actions=actions)

        replay_fit = self.replay_fit.within(budget)
        return run_bootstrap(
            replay_fit, synthesize, fit, start, plan.num_worlds, rng, extend_horizon, budget
        )


def _simulator_of(context: SearchContext) -> Simulator:
    """Of a context that can fit."""
    assert isinstance(context.simulator, Simulator), "see SearchContext.can_fit"
    return context.simulator


def _as_observed(context: SearchContext, held_out: HeldOut) -> Observed:
    """Held-out worlds as a fit sees a real one."""
    worlds, shape = held_out.worlds, context.simulator.shape
    tracks = KeypointTracks.of_detections(held_out.episodes, shape, held_out.noise())
    evidence = context.observation.evidence(tracks, worlds.readings)
    return Observed(evidence, worlds.filmed_actions().astype(float))


def _appearance(context: SearchContext) -> tuple[np.ndarray, Photometry]:
    """(N,) standard deviations of errors that no fit can detect, and what is known of colours."""
    space = context.simulator.space
    known = np.full(len(space), np.nan) if context.known is None else context.known
    photometry = Photometry(context.observation.image_noise, known)
    discrepancy = context.observation.discrepancy_std(space.is_appearance)
    return np.where(photometry.is_known, 0.0, discrepancy), photometry


def _scaled_as(evidence: AllEvidence, other: AllEvidence) -> AllEvidence:
    """Evidence whose joint readings are features on the scale of another's."""
    like = {part.name: part for part in other.parts if isinstance(part, JointReadings)}
    return evidence.with_each(JointReadings, lambda part: part.scaled_as(like[part.name]))


def _with_inflated_noise(evidence: AllEvidence) -> AllEvidence:
    """Evidence whose joint readings count as if they were noisier."""
    return evidence.with_each(
        JointReadings, lambda part: replace(part, noise=_NOISE_INFLATION * part.noise)
    )
