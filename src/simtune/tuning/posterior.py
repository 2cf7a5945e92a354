"""search="posterior": move straight to the median, narrow the range, simulate again.

A round is sequential neural posterior estimation with a truncated prior, followed by a fit:

    simulate                    worlds drawn from Ξ replay the real actions; pictures of them
    train the detector          keypoints and visible parameters in single pictures
    train the posterior network survival curves from whole episodes with the detector's errors
    estimate                    detect in the real frames, once; read the curves
    fit and judge               test the detector in worlds like the real one; replay the motion,
                                draw the pictures; a bootstrap widens intervals
    doubt                       if the robot is where no simulated world gets
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from simtune.budget import Budget
from simtune.errors import InputError
from simtune.networks.layers import load_generator, load_weights, under
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.search_param_model.posterior_net import SHORTEST_STEPS
from simtune.trajectory import Trajectory
from simtune.tuning.earlier import Earlier
from simtune.tuning.estimate import Estimate
from simtune.tuning.familiarity import doubted, how_strange
from simtune.tuning.fit_verdict import conclude_by_networks
from simtune.tuning.judging import Judging
from simtune.tuning.learning import Learned, Learning
from simtune.tuning.pace import Pace, Work, smallest
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.range_update import doubted_at_edges, update_range
from simtune.tuning.readings_estimate import ReadingsEstimate
from simtune.tuning.rounds import Rounds, half_widths
from simtune.tuning.search import (
    NO_CALLBACKS,
    Callbacks,
    Event,
    Needed,
    Round,
    SearchContext,
)
from simtune.tuning.world_sampler import WorldSampler
from simtune.vision.detections import Detections

_READINGS_SHARE = 0.35  # of all time, for the fit to readings alone
# At least, since keypoints of what readings tell are not looked for (`keypoints_of_run`)
_LEAST_READINGS_SHARE = 0.15


class PosteriorSearch:
    """Search with the posterior SPM; a `tuning.search.Search`."""

    def __init__(self, context: SearchContext, config: PosteriorSearchConfig | None = None):
        """Raises InputError if nothing moves that could show a hidden parameter."""
        _check_shown(context)
        space = context.simulator.space
        self.config = config = config or PosteriorSearchConfig()
        self.context = context
        self.first = self.distribution = context.first
        every, moving = np.arange(len(space)), np.flatnonzero(~space.is_appearance)
        is_dimmed = config.tolerates_brightness and context.observation.image_noise is not None
        is_of_motion = is_dimmed and len(moving) > 0
        self._counted = moving if is_of_motion else every  # parameters that must be precise
        counted = "parameter of the motion" if is_of_motion else "parameter"
        self._rounds = Rounds(config.num_rounds, config.precision, counted)
        self.model = PosteriorSearchParamModel(
            len(context.keypoints),
            context.simulator.action_scale,
            space.is_visible,
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
        self._full_s = math.inf  # for a whole round, if time is limited
        self._least_s = 0.0  # for the smallest sound round
        self._picture_s = 0.0  # to draw and to look at one
        # Of an unfinished round, once its detector is trained: metrics, and the state of its
        # worlds' generator, to simulate them again
        self._unfinished: dict[str, Any] | None = None
        # By joint readings alone, of the episodes before the first round, which come last; a later
        # session reads the same ones again
        self._by_readings: ReadingsEstimate | None = None
        self._num_read = 0
        self._earlier = Earlier()

    @property
    def num_rounds(self) -> int:
        """Finished rounds."""
        return self._rounds.num_done

    @property
    def stop_reason(self) -> str:
        return self._rounds.stop_reason

    def check(self, real: list[Trajectory]) -> None:
        """Raises InputError if there are no trajectories, or too short ones."""
        if not real:
            raise InputError("no episodes: there is nothing to tune to")
        lengths = [len(t) for t in real]
        if (steps := min(lengths)) < SHORTEST_STEPS:
            raise InputError(
                f"episode {lengths.index(steps)}, counted from 0, has {steps} steps; expected at "
                f"least {SHORTEST_STEPS}: leave it out, or record a longer one"
            )

    def measure_time(self, real: list[Trajectory]) -> Needed:
        """See `Search`."""
        pace = Pace.measure(self.context, self.model, self.first)
        can_fit, least = self.context.can_fit, smallest(self.config)
        work = Work.of(self.context.simulator, real, can_fit)
        self._full_s = pace.round_s(self.config, work)
        self._least_s = pace.round_s(least, work)
        self._picture_s = pace.frame_s + pace.detect_s
        check_s = pace.check_s(work, bool(self.context.observation.sensors)) * can_fit
        return Needed(self._least_s, self._full_s, check_s, pace.mostly(least, work))

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        callbacks: Callbacks = NO_CALLBACKS,
    ) -> Round:
        """Simulate, train the detector and the posterior network, estimate, fit and judge."""
        real = self._fit_readings(real, budget)
        budget, may_be_last = self._plan(real, budget)
        learned, metrics = self._learn(real, budget, callbacks.save)
        estimate, curves = self._judge(learned, may_be_last, budget, callbacks)
        estimate, events = self._move(estimate, curves, learned.searched)
        return Round(estimate, events, metrics)

    def _learn(
        self, real: list[Trajectory], budget: Budget, save: Callable[[], None]
    ) -> tuple[Learned, dict[str, float]]:
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
        learned = Learned(searched, worlds.keypoints, held_out, detected, curves)
        return learned, self._unfinished["metrics"] | metrics

    def _judge(
        self, learned: Learned, may_be_last: bool, budget: Budget, callbacks: Callbacks
    ) -> tuple[Estimate, np.ndarray]:
        """Fit and judge, where that is possible; doubt. Also returns the (N, C) curves."""
        by_readings = self._by_readings
        if self.context.can_fit:
            judging = Judging.prepare(
                self.context,
                self._learning,
                learned,
                by_readings,
                self._earlier,
                budget,
                self._picture_s,
            )
            estimate, curves = judging.judge(may_be_last, budget, callbacks)
            self._earlier = judging.earlier
        else:
            config = self.config.range_update
            estimate, curves = conclude_by_networks(learned, self.context, config)
        if by_readings is None or not by_readings.is_used:
            strange = how_strange(learned.keypoints, learned.held_out, learned.detected)
            estimate = doubted(estimate, strange)
        return estimate, curves

    def _move(
        self, estimate: Estimate, curves: np.ndarray, searched: Distribution
    ) -> tuple[Estimate, list[Event]]:
        """Move Ξ, and end the round; returns the estimate with the doubts that this raises."""
        self.distribution, events = update_range(
            curves, searched, self.first, self.config.range_update
        )
        is_judged = bool(estimate.ranks)
        if not self.context.can_fit:
            estimate = doubted_at_edges(estimate, events)
            is_judged = all(event.event != "widened" for event in events)
        self._earlier = self._earlier.with_doubts(estimate)
        widths = half_widths(estimate, self.first)[self._counted]
        # A user reads the verdicts; a policy does not.
        are_identified = all(estimate.verdict[i] == "identified" for i in self._counted)
        self._rounds.end(widths, are_identified or not self.config.for_policy, is_judged)
        self._unfinished = None
        return estimate, events

    def _fit_readings(self, real: list[Trajectory], budget: Budget) -> list[Trajectory]:
        """Fit readings alone; returns trajectories, with actions when they took effect."""
        if not self.context.can_fit:
            return real
        left = budget.seconds_left
        spare = max(left - self._least_s, _LEAST_READINGS_SHARE * left)
        seconds = left if budget.is_endless else min(_READINGS_SHARE * left, spare)
        if self._by_readings is None:
            part = budget.part(seconds, (0.0, 0.1), "readings: ")
            self._num_read = self._num_read or len(real)
            first = real[-self._num_read :]
            self._by_readings = ReadingsEstimate.fitted(self.context, first, part)
        if self._by_readings is None:
            return real
        self.distribution = self._by_readings.narrowed(self.distribution)
        return self._by_readings.without_delay(real)

    def _plan(self, real: list[Trajectory], budget: Budget) -> tuple[Budget, bool]:
        """The present round's part of the budget, and whether the round may be the last one."""
        if not budget.is_endless and math.isinf(self._full_s):
            self.measure_time(real)
        return self._rounds.plan(budget, self._full_s)

    def detect(self, frames: np.ndarray) -> Detections:
        return self.model.detect(frames)

    def tensors(self) -> dict[str, torch.Tensor]:
        parts = {"detector": self.model.detector, "posterior_net": self.model.posterior_net}
        tensors = {f"{p}.{k}": v for p, m in parts.items() for k, v in m.state_dict().items()}
        return tensors | {"generator": self.model.generator.get_state()}

    def state(self) -> dict[str, Any]:
        rng = (self._unfinished or {}).get("rng") or self._learning.worlds.rng.bit_generator.state
        changing = {"distribution": self.distribution.state(), "rng": rng}
        changing |= {"unfinished": self._unfinished, "earlier": self._earlier.to_json()}
        changing["num_read"] = self._num_read
        return self._rounds.state() | changing

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        load_weights(self.model.detector, under("detector.", tensors), "detector")
        load_weights(self.model.posterior_net, under("posterior_net.", tensors), "posterior_net")
        load_generator(self.model.generator, tensors["generator"])
        self._rounds.load(state)
        self.distribution = self.distribution.with_state(state["distribution"])
        self._learning.worlds.rng.bit_generator.state = state["rng"]
        self._unfinished, self._num_read = state["unfinished"], state["num_read"]
        self._earlier = Earlier.from_json(state["earlier"])


def _check_shown(context: SearchContext) -> None:
    """Raises InputError if nothing moves that could show a hidden parameter."""
    hidden = [p.name for p in context.simulator.space if not p.is_visible]
    if hidden and not len(context.keypoints):
        raise InputError(
            f"{hidden[0]} shows in motion only, and nothing moves in the simulator's episodes: "
            "have them start elsewhere, act, or leave the parameter out"
        )
