"""search="posterior": move straight to the median, narrow the range, simulate again.

A round is sequential neural posterior estimation with a truncated prior, followed by a fit:

    fit the readings            alone, in whole episodes, if there are any; once
    plan                        how long the round may take, and whether it may be the last
    simulate                    worlds drawn from Ξ replay the real actions; pictures of them
    train the detector          keypoints and visible parameters in single pictures
    train the posterior network survival curves from whole episodes with the detector's errors
    estimate                    detect in the real frames, once; read the curves
    fit and judge               test the detector in worlds like the real one; replay the motion,
                                draw the pictures; a bootstrap widens intervals
    doubt                       if the robot is where no simulated world gets
    move                        Ξ to where the curves say that the truth is
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from simtune.budget import Budget
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.trajectory import Trajectory
from simtune.tuning.earlier_rounds import EarlierRounds
from simtune.tuning.edges import doubted_at_edges, leads_beyond
from simtune.tuning.estimate import Estimate
from simtune.tuning.familiarity import doubted, measure_strangeness
from simtune.tuning.fit_verdict import conclude_by_networks
from simtune.tuning.fitting import Fitting
from simtune.tuning.judging import Judging
from simtune.tuning.learning import Learning, LearningResult
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.posterior_scope import refuse_short, refuse_what_never_shows, what_counts
from simtune.tuning.range_update import update_range
from simtune.tuning.readings.estimate import ReadingsEstimate
from simtune.tuning.readings.first import ReadingsFirst
from simtune.tuning.round_times import RoundTimes, measure_times
from simtune.tuning.rounds import Rounds, RoundTime, half_widths
from simtune.tuning.search import (
    NO_CALLBACKS,
    Callbacks,
    Event,
    Round,
    Search,
    SearchContext,
    TimeNeeded,
)
from simtune.tuning.world_sampler import WorldSampler
from simtune.vision.detections import Detections


class PosteriorSearch(Search):
    """Search with the posterior SPM."""

    def __init__(self, context: SearchContext, config: PosteriorSearchConfig | None = None):
        """Raises InputError if nothing moves that could show a hidden parameter."""
        refuse_what_never_shows(context)
        self.config = config = config or PosteriorSearchConfig()
        self.context = context
        self.first = self.distribution = context.first
        self._counted, counted = what_counts(context, config.tolerates_brightness)
        self._rounds = Rounds(config.num_rounds, config.precision, counted)
        self.model = PosteriorSearchParamModel(
            len(context.keypoints),
            context.simulator.action_scale,
            context.simulator.space.is_visible,
            context.simulator.shape,
            config.model,
            context.seed,
            context.device,
        )
        self._learning = Learning(
            model=self.model,
            worlds=WorldSampler(context),
            config=config,
            is_fitted=context.can_fit,
        )
        self._times: RoundTimes | None = None  # measured if time is limited
        # Of an unfinished round, once its detector is trained: metrics, and the state of its
        # worlds' generator, to simulate them again
        self._unfinished: dict[str, Any] | None = None
        self._readings_first = ReadingsFirst(context)
        self._earlier = EarlierRounds()

    @property
    def num_rounds(self) -> int:
        """Finished rounds."""
        return self._rounds.num_done

    @property
    def stop_reason(self) -> str:
        return self._rounds.stop_reason

    def check(self, real: list[Trajectory], names: Sequence[str] = ()) -> None:
        """Raises InputError if there are no trajectories, or too short ones."""
        refuse_short(real, names)

    def measure_time(self, real: list[Trajectory]) -> TimeNeeded:
        """See `Search`."""
        self._times, needed = measure_times(self.context, self.model, self.config, real)
        return needed._replace(first_s=self._readings_first.measure_s(real))

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        callbacks: Callbacks = NO_CALLBACKS,
    ) -> Round:
        """See the top of this file."""
        least_s = self._times.least_s if self._times else 0.0
        by_readings = self._readings_first.fit(real, least_s, budget)
        if by_readings:
            self.distribution = by_readings.narrowed(self.distribution)
            real = by_readings.without_delay(real)
        given = self._plan(real, budget)
        learned, metrics = self._learn(real, given.budget, callbacks.save)
        estimate, curves = self._judge(learned, by_readings, given, callbacks)
        lacked_time = not budget.is_endless and self._lacked_time
        estimate, events = self._move(estimate, curves, learned.searched, lacked_time)
        if doubts := self._readings_first.warnings:  # not stored: a later round has its own
            estimate = replace(estimate, warnings=[*doubts, *estimate.warnings])
        return Round(estimate, events, metrics)

    def _learn(
        self, real: list[Trajectory], budget: Budget, save: Callable[[], None]
    ) -> tuple[LearningResult, dict[str, float]]:
        """Simulate, and train the networks; also returns what is to be logged.

        `save` is called once the detector is trained.
        """
        learning, searched = self._learning, self.distribution
        began = learning.worlds.rng.bit_generator.state
        worlds, pictures = learning.simulate(real, searched, budget)
        if self._unfinished is None:
            metrics = learning.train_detector(pictures, searched, self.num_rounds, budget)
            self._unfinished = {"metrics": metrics, "rng": began}
            save()
        del pictures  # most of the memory
        held_out = learning.hold_out(real, searched, budget)
        metrics = learning.train_posterior_net(real, worlds, held_out, searched, budget)
        detected = learning.detect(real)  # before a fit is sized by the time that is left
        curves = learning.curves(detected, searched)
        learned = LearningResult(searched, worlds.keypoints, held_out, detected, curves)
        return learned, self._unfinished["metrics"] | metrics

    def _judge(
        self,
        learned: LearningResult,
        by_readings: ReadingsEstimate | None,
        given: RoundTime,
        callbacks: Callbacks,
    ) -> tuple[Estimate, np.ndarray]:
        """Fit and judge, where that is possible; doubt. Also returns the (N, C) curves."""
        if self.context.can_fit:
            has_earlier = self._earlier.estimate is not None
            judging = Judging(
                context=self.context,
                fitting=Fitting.prepare(
                    self.context, self._learning, learned, by_readings, has_earlier, given.budget
                ),
                by_readings=by_readings,
                earlier=self._earlier,
                picture_s=self._times.picture_s if self._times else 0.0,
            )
            estimate, curves, self._earlier = judging.judge(given, callbacks)
        else:
            estimate, curves = conclude_by_networks(learned, self.context)
        if by_readings is None or not by_readings.is_used:
            strangeness = measure_strangeness(learned.keypoints, learned.held_out, learned.detected)
            estimate = doubted(estimate, strangeness)
        return estimate, curves

    @property
    def _lacked_time(self) -> bool:
        """Whether more time would tell users more of what verdicts rest on; a policy reads none."""
        if self.config.for_policy or not self.context.can_fit:
            return False
        lacks_refits = self._earlier.lacks_refits(self.config.most_refits)
        return lacks_refits or self._readings_first.lacked_time

    def _move(
        self,
        estimate: Estimate,
        curves: np.ndarray,
        searched: Distribution,
        lacked_time: bool = False,
    ) -> tuple[Estimate, list[Event]]:
        """Move Ξ, and end the round; returns the estimate with the doubts that this raises.

        `lacked_time`: see `Rounds.end`.
        """
        self.distribution, events = update_range(curves, searched, self.first)
        can_fit = self.context.can_fit
        is_judged = bool(estimate.ranks) or not can_fit
        is_judged &= not leads_beyond(curves, searched, events, can_fit)
        if not can_fit:
            estimate = doubted_at_edges(estimate, events)
        self._earlier = self._earlier.with_doubts(estimate)
        widths = half_widths(estimate, self.first)[self._counted]
        # A user reads the verdicts; a policy does not.
        are_identified = all(estimate.verdict[i] == "identified" for i in self._counted)
        may_be_known = are_identified or not self.config.for_policy
        self._rounds.end(widths, may_be_known, is_judged, lacked_time)
        self._unfinished = None
        return estimate, events

    def _plan(self, real: list[Trajectory], budget: Budget) -> RoundTime:
        """How long the present round may take."""
        if not budget.is_endless and self._times is None:
            self.measure_time(real)
        return self._rounds.plan(budget, self._times.whole_s if self._times else math.inf)

    def detect(self, frames: np.ndarray) -> Detections:
        return self.model.detect(frames)

    def tensors(self) -> dict[str, torch.Tensor]:
        return self.model.tensors()

    def state(self) -> dict[str, Any]:
        rng = (self._unfinished or {}).get("rng") or self._learning.worlds.rng.bit_generator.state
        return self._rounds.state() | {
            "distribution": self.distribution.state(),
            "rng": rng,
            "unfinished": self._unfinished,
            "earlier": self._earlier.to_json(),
            "readings_first": self._readings_first.state(),
        }

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        self.model.load(tensors)
        self._rounds.load(state)
        self.distribution = self.distribution.with_state(state["distribution"])
        self._learning.worlds.rng.bit_generator.state = state["rng"]
        self._unfinished = state["unfinished"]
        self._earlier = EarlierRounds.from_json(state["earlier"])
        self._readings_first.load(state["readings_first"])
