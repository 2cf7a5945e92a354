"""search="posterior": straight to the median, narrow the range, simulate again.

A round is sequential neural posterior estimation with a truncated prior, and then a fit:

    simulate                    worlds drawn from Ξ replay the real actions; a part is filmed
    train the detector          keypoints and visible parameters in single pictures
    train the posterior network survival curves from whole episodes, spoilt as the detector errs
    estimate                    detect in the real frames, once; read the curves
    fit and judge               replay the motion, draw the pictures; a bootstrap widens intervals
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from simtune.budget import Budget
from simtune.errors import InputError
from simtune.fit import Bootstrap, num_fitted
from simtune.networks import load_weights, under
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.search_param_model.posterior_net import SHORTEST_STEPS
from simtune.search_param_model.simulated import SimulatedWorlds
from simtune.training import TrainingClock
from simtune.trajectory import Trajectory
from simtune.tuning.fit_stage import Detected, FitStage, HeldOut, can_fit, conclude
from simtune.tuning.pace import Pace, Work, smallest
from simtune.tuning.posterior_config import FILMED_WITHOUT_FIT, PosteriorSearchConfig
from simtune.tuning.range_update import (
    candidate_grid,
    point_estimate,
    read_curves,
    update_range,
)
from simtune.tuning.rounds import gains_nothing, half_widths, is_precise, plan_round
from simtune.tuning.search import Estimate, Round, SearchContext
from simtune.tuning.told import Told
from simtune.tuning.world_sampler import WorldSampler

_FITS_SHARE = 0.9  # of what is left then, for a fit and its refits
_READINGS_SHARE = 0.35  # of all the time, for what readings alone tell
_WORTH_BEGINNING = 0.5  # of a fit: time that is left, with which a refit may be finished
_REFIT = 0.9  # of a fit: it looks at fewer episodes, which are filmed before


class PosteriorSearch:
    """Search by the posterior SPM; a `tuning.search.Search`."""

    def __init__(self, context: SearchContext, config: PosteriorSearchConfig | None = None):
        """Raises InputError where nothing moves that a hidden parameter could show in."""
        space = context.simulator.space
        hidden = [p.name for p in space if not p.is_visible]
        if hidden and not len(context.keypoints):
            raise InputError(
                f"{hidden[0]} shows in motion only, and nothing moves in the simulator's episodes: "
                "have them start elsewhere, act, or leave the parameter out"
            )
        self.config = config = config or PosteriorSearchConfig()
        self.context, self._can_fit = context, can_fit(context)
        self.first = self.distribution = Distribution.first(space, context.start)
        self.searched = self.first  # in the last round: what its curves are in terms of
        self.num_rounds = 0
        self.stop_reason = ""
        self._widths: list[float] | None = None  # of the last round's intervals, relative
        self.model = PosteriorSearchParamModel(
            len(context.keypoints),
            context.simulator.action_scale,
            space.is_visible,
            context.simulator.shape,
            config.model,
            context.seed,
        )
        self._worlds = WorldSampler(context)
        self._full_s = math.inf  # that a whole round takes, where time is limited
        self._least_s = 0.0  # that the smallest sound one takes
        # What a round learnt beside the networks' weights; no checkpoint has it.
        self._told: Told | None = None  # by joint readings alone, before the first round
        self._fit_stage: FitStage | None = None
        self._bootstrap: Bootstrap | None = None

    def check(self, real: list[Trajectory]) -> None:
        """Raises InputError where there are no trajectories, or too short ones."""
        steps = min((len(t) for t in real), default=0)
        if steps < SHORTEST_STEPS:
            raise InputError(
                f"--search posterior needs episodes of at least {SHORTEST_STEPS} steps, "
                + (f"got one of {steps}" if real else "got none")
            )

    def run_round(self, real: list[Trajectory], budget: Budget) -> Round:
        """Simulate, train the detector and the posterior network, estimate, fit and judge."""
        real = self._listen(real, budget)
        budget, may_be_last = self._plan(real, budget)
        self.searched = self.distribution
        worlds = self._simulate(real, budget)
        metrics = self._train_detector(worlds, budget)
        held_out = self._hold_out(real, budget)
        metrics |= self._train_posterior_net(real, worlds.without_frames(), held_out, budget)
        self._fit_stage = self._prepare_fit(real, held_out, budget)
        detected = self._detect(real)
        prob_higher = self._estimate(detected)
        estimate, curves = self._fit_and_judge(detected, prob_higher, may_be_last, budget)
        self.distribution, events = update_range(
            curves, self.distribution, self.first, self.config.range_update
        )
        self.num_rounds += 1
        self._see_whether_to_stop(half_widths(estimate, self.first))
        return Round(estimate, events, metrics)

    def _listen(self, real: list[Trajectory], budget: Budget) -> list[Trajectory]:
        """To readings alone; the trajectories, with actions when they took effect."""
        if not self._can_fit:
            return real
        left = budget.seconds_left
        seconds = left if budget.is_endless else min(_READINGS_SHARE * left, left - self._least_s)
        if self._told is None and seconds > 0:
            part = budget.part(seconds, (0.0, 0.1), "readings: ")
            self._told = Told.by_readings(self.context, real, part)
        if self._told is None:
            return real
        self.distribution = self._told.narrowed(self.distribution)
        return self._told.late(real)

    def _see_whether_to_stop(self, widths: np.ndarray) -> None:
        precision, before = self.config.precision, self._widths
        if precision and is_precise(widths, precision):
            self.stop_reason = f"every parameter is known to {100 * precision:g} %"
        elif precision and before and gains_nothing(np.array(before), widths, precision):
            self.stop_reason = "another round would tell hardly more"
        elif self.num_rounds >= self.config.num_rounds:
            self.stop_reason = "all rounds are done"
        self._widths = widths.tolist()

    def needed_s(self, real: list[Trajectory]) -> tuple[float, float]:
        """Seconds that the smallest sound round takes on this machine, and those of a whole one."""
        pace = Pace.measure(self.context, self.model, self.first)
        work, config = self._work(real), self.config
        self._full_s, self._least_s = (pace.round_s(c, work) for c in (config, smallest(config)))
        return self._least_s, self._full_s

    def _work(self, real: list[Trajectory]) -> Work:
        steps = min(len(t) for t in real)
        simulator = self.context.simulator
        space = simulator.state_space if self._can_fit else None
        num_tangent = space.num_tangent if space else 0
        num_fitted = int((~self.first.space.is_appearance).sum())
        return Work(len(real), steps, num_tangent, num_fitted, simulator.supersampling)

    def estimate(self, trajectories: list[Trajectory]) -> tuple[Estimate, np.ndarray]:
        """What the last round would have made of other trajectories; and (N, C) curves.

        The curves are on `candidate_grid`, in coordinates of the range `searched`. Raises
        RuntimeError for a search that was loaded and has done no round since.
        """
        if self._fit_stage is None and self._can_fit:
            raise RuntimeError("what a fit learnt is in no checkpoint: run a round first")
        detected = self._detect(trajectories)
        return self._fit_and_judge(detected, self._estimate(detected))

    def _plan(self, real: list[Trajectory], budget: Budget) -> tuple[Budget, bool]:
        """The part of the present round, and whether it may be the last one."""
        count = self.config.num_rounds
        index = min(self.num_rounds, count - 1)
        span, name = (index / count, (index + 1) / count), f"round {self.num_rounds + 1}: "
        if budget.is_endless:
            return budget.part(math.inf, span, name), index == count - 1
        if math.isinf(self._full_s):
            self.needed_s(real)
        seconds = plan_round(budget.seconds_left, self._full_s, index == count - 1)
        return budget.part(seconds, span, name), True

    def _simulate(self, real: list[Trajectory], budget: Budget) -> SimulatedWorlds:
        config = self.config
        budget.report("simulating and filming")
        episodes, part = self._episodes_per_world(real), budget.share(config.collect_share)
        return self._worlds.sample(
            real, self.searched, config.num_worlds, episodes, config.filmed_steps, part
        )

    def _train_detector(self, worlds: SimulatedWorlds, budget: Budget) -> dict[str, float]:
        config = self.config
        updates = config.detector_updates[min(self.num_rounds, len(config.detector_updates) - 1)]
        part = budget.share(config.detector_share, (0.1, 0.4))
        clock = TrainingClock(updates, part, "training the detector", config.least_updates)
        return {"loss/detector": self.model.train_detector(worlds, self.searched, clock)}

    def _hold_out(self, real: list[Trajectory], budget: Budget) -> HeldOut:
        """Other worlds, to measure the detector's errors in."""
        config, part = self.config, budget.share(self.config.collect_share / 2)
        worlds = self._worlds.sample(
            real, self.searched, config.held_out_worlds, 1, config.held_out_steps, part
        )
        return HeldOut(worlds, self.model.detect(worlds.frames))

    def _train_posterior_net(
        self, real: list[Trajectory], worlds: SimulatedWorlds, held_out: HeldOut, budget: Budget
    ) -> dict[str, float]:
        """Where it has the last word, as no fit follows, it learns from more worlds, for longer."""
        config, errors = self.config, self.model.detector_errors(*held_out, self.searched)
        scale = 1 if self._can_fit else config.no_fit_scale
        if scale > 1:
            num, episodes = config.num_worlds * scale, self._episodes_per_world(real)
            part = budget.share(config.collect_share)
            worlds = self._worlds.sample(
                real, self.searched, num, episodes, FILMED_WITHOUT_FIT, part
            )
        part = budget.share(config.posterior_share * scale, (0.4, 0.5))
        updates, least = config.posterior_updates * scale, config.least_updates
        clock = TrainingClock(updates, part, "training the posterior network", least)
        loss = self.model.train_posterior_net(worlds, self.searched, errors, clock)
        size_px = np.abs(errors.keypoints)
        error_px = float(np.median(size_px)) if size_px.size else 0.0
        return {"loss/posterior_net": loss, "detector/error_px": error_px}

    def _prepare_fit(
        self, real: list[Trajectory], held_out: HeldOut, budget: Budget
    ) -> FitStage | None:
        if not self._can_fit:
            return None
        num_steps = min(len(t) for t in real) * len(real)
        held = tuple(np.flatnonzero(self._told.is_held)) if self._told else ()
        config = replace(self.config, fit=replace(self.config.fit, held=held))
        stage = FitStage.prepare(self.context, self.model, held_out, config, budget)
        fits = 1 + _REFIT * self.config.num_refits[0]
        return stage.sized(num_steps, _FITS_SHARE * budget.seconds_left / fits)

    def _detect(self, trajectories: Sequence[Trajectory]) -> Detected:
        return Detected(trajectories, [self.model.detect(t.frames) for t in trajectories])

    def _estimate(self, detected: Detected) -> np.ndarray:
        """(N, C) survival curves of the posterior network on the grid."""
        # As a fit does, it leaves an episode to test on.
        num = num_fitted(len(detected.trajectories)) if self._can_fit else None
        trajectories, detections = detected.trajectories[:num], detected.detections[:num]
        steps = min(len(t) for t in trajectories)
        actions = np.stack([t.actions[:steps] for t in trajectories])
        curves = self.model.curves(detections, actions, self.searched)
        grid = torch.tensor(candidate_grid(), dtype=torch.float32)
        return curves.prob_higher(grid.expand(1, len(self.first.mean), -1))[0].numpy()

    def _fit_and_judge(
        self,
        detected: Detected,
        prob_higher: np.ndarray,
        may_be_last: bool = True,
        budget: Budget | None = None,
    ) -> tuple[Estimate, np.ndarray]:
        """Fit, and conclude; with a budget, known worlds are fitted for comparison until then.

        What may not be the last round does without them, and without longer windows.
        """
        config, stage, began_s = self.config, self._fit_stage, time.monotonic()
        if stage is None:
            estimate = read_curves(prob_higher, self.searched, self.first, config.range_update)
            return estimate, prob_higher
        (budget or Budget()).report("fitting", 0.55)
        observed = stage.observed(*detected)
        start = point_estimate(prob_higher, self.searched)
        start = self._told.start(start) if self._told else start
        fit = stage.fit(observed, start, may_be_last)
        if budget:
            num = self._num_refits(budget, time.monotonic() - began_s) if may_be_last else 0
            rng, part = self._worlds.rng, budget.part(budget.seconds_left, (0.65, 1.0))
            self._bootstrap = stage.bootstrap(observed, fit, start, num, rng, may_be_last, part)
        assert self._bootstrap is not None, "made in a round"
        ranges = (self.searched, self.first)
        estimate, curves = conclude(prob_higher, fit, self._bootstrap, *ranges, config.range_update)
        labels = self.context.observation.reading_labels
        offsets = dict(zip(labels, fit.offsets.tolist(), strict=False))
        estimate = replace(estimate, offsets=offsets)
        return self._told.better(estimate) if self._told else estimate, curves

    def _num_refits(self, budget: Budget, fit_s: float) -> int:
        """To begin with, after a fit that took so long: what does not end in time is left out."""
        planned, most = self.config.num_refits
        if budget.is_endless:
            return planned
        # They may take less: of them no latency is looked for.
        return most if budget.seconds_left > _WORTH_BEGINNING * fit_s else 0

    def _episodes_per_world(self, real: list[Trajectory]) -> int:
        return min(self.config.episodes_per_world, len(real))

    def tensors(self) -> dict[str, torch.Tensor]:
        parts = {"detector": self.model.detector, "posterior_net": self.model.posterior_net}
        tensors = {f"{p}.{k}": v for p, m in parts.items() for k, v in m.state_dict().items()}
        return tensors | {"generator": self.model.generator.get_state()}

    def state(self) -> dict[str, Any]:
        return {
            "num_rounds": self.num_rounds,
            "stop_reason": self.stop_reason,
            "distribution": self.distribution.state(),
            "rng": self._worlds.rng.bit_generator.state,
            "widths": self._widths,
        }

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        load_weights(self.model.detector, under("detector.", tensors), "detector")
        load_weights(self.model.posterior_net, under("posterior_net.", tensors), "posterior_net")
        self.model.generator.set_state(tensors["generator"])
        self.num_rounds, self.stop_reason = state["num_rounds"], state["stop_reason"]
        self._widths = state["widths"]
        self.distribution = self.distribution.with_state(state["distribution"])
        self._worlds.rng.bit_generator.state = state["rng"]
