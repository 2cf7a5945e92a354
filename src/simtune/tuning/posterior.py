"""search="posterior": straight to the median, narrow the range, simulate again.

A round is sequential neural posterior estimation with a truncated prior, and then a fit:

    simulate                    worlds drawn from Ξ replay the real actions; a part is filmed
    train the detector          keypoints and visible parameters in single pictures
    train the posterior network survival curves from whole episodes, spoilt as the detector errs
    estimate                    detect in the real frames, once; read the curves
    fit and judge               replay the motion, draw the pictures; a bootstrap widens intervals
"""

import time
from collections.abc import Sequence
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
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.range_update import (
    candidate_grid,
    point_estimate,
    read_curves,
    update_range,
)
from simtune.tuning.search import Estimate, Round, SearchContext
from simtune.tuning.world_sampler import WorldSampler

_SECONDS_AT_LEAST = 1.0  # that a round is planned for, however late it is
_FILMED_WITHOUT_FIT = 2  # frames: what those worlds look like is known from others


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
        self.model = PosteriorSearchParamModel(
            len(context.keypoints),
            context.simulator.action_scale,
            space.is_visible,
            context.simulator.image_size,
            config.model,
            context.seed,
        )
        self._worlds = WorldSampler(context, self.first)
        # What a round learnt beside the networks' weights; no checkpoint has it.
        self._fit_stage: FitStage | None = None
        self._bootstrap: Bootstrap | None = None

    @property
    def finished(self) -> bool:
        return self.num_rounds >= self.config.num_rounds

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
        budget, is_last = self._plan(budget)
        self.searched = self.distribution
        worlds = self._simulate(real, budget)
        metrics = self._train_detector(worlds, budget)
        held_out = self._hold_out(real, budget)
        metrics |= self._train_posterior_net(real, worlds.without_frames(), held_out, budget)
        self._fit_stage = self._prepare_fit(real, held_out, budget)
        detected = self._detect(real)
        prob_higher = self._estimate(detected)
        estimate, curves = self._fit_and_judge(detected, prob_higher, is_last, budget)
        self.distribution, events = update_range(
            curves, self.distribution, self.first, self.config.range_update
        )
        self.num_rounds += 1
        return Round(estimate, events, metrics)

    def estimate(self, trajectories: list[Trajectory]) -> tuple[Estimate, np.ndarray]:
        """What the last round would have made of other trajectories; and (N, C) curves.

        The curves are on `candidate_grid`, in coordinates of the range `searched`. Raises
        RuntimeError for a search that was loaded and has done no round since.
        """
        if self._fit_stage is None and self._can_fit:
            raise RuntimeError("what a fit learnt is in no checkpoint: run a round first")
        detected = self._detect(trajectories)
        return self._fit_and_judge(detected, self._estimate(detected), self.finished)

    def _plan(self, budget: Budget) -> tuple[Budget, bool]:
        """The part of the present round, and whether it is the last one."""
        count = self.config.num_rounds
        index = min(self.num_rounds, count - 1)
        shares = self.config.time_shares[self.num_rounds :] or (1.0,)
        seconds = budget.seconds_left * shares[0] / sum(shares)
        part = budget.part(
            max(_SECONDS_AT_LEAST, seconds),
            (index / count, (index + 1) / count),
            f"{index + 1}/{count} ",
        )
        return part, index == count - 1 or budget.is_over

    def _simulate(self, real: list[Trajectory], budget: Budget) -> SimulatedWorlds:
        config = self.config
        budget.report("simulating and filming")
        episodes, seconds = self._episodes_per_world(real), budget.seconds * config.collect_share
        return self._worlds.sample(
            real, self.searched, config.num_worlds, episodes, config.filmed_steps, seconds
        )

    def _train_detector(self, worlds: SimulatedWorlds, budget: Budget) -> dict[str, float]:
        config = self.config
        updates = config.detector_updates[min(self.num_rounds, len(config.detector_updates) - 1)]
        part = budget.part(budget.seconds * config.detector_share, (0.1, 0.6))
        clock = TrainingClock(updates, part, "training the detector", config.least_updates)
        return {"loss/detector": self.model.train_detector(worlds, self.searched, clock)}

    def _hold_out(self, real: list[Trajectory], budget: Budget) -> HeldOut:
        """Other worlds, to measure the detector's errors in."""
        config, seconds = self.config, budget.seconds * self.config.collect_share
        worlds = self._worlds.sample(
            real, self.searched, config.held_out_worlds, 1, config.held_out_steps, seconds
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
            seconds = budget.seconds * config.collect_share
            worlds = self._worlds.sample(
                real, self.searched, num, episodes, _FILMED_WITHOUT_FIT, seconds
            )
        part = budget.part(budget.seconds * config.posterior_share * scale, (0.6, 0.7))
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
        return FitStage.prepare(self.context, self.model, held_out, self.config, num_steps, budget)

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
        is_last: bool,
        budget: Budget | None = None,
    ) -> tuple[Estimate, np.ndarray]:
        """Fit, and conclude; with a budget, known worlds are fitted for comparison until then.

        They are in the last round only, and what is fitted once more can wait for longer windows.
        """
        config, stage, began_s = self.config, self._fit_stage, time.monotonic()
        if stage is None:
            estimate = read_curves(prob_higher, self.searched, self.first, config.range_update)
            return estimate, prob_higher
        (budget or Budget()).report("fitting", 0.8)
        observed = stage.observed(*detected)
        start = point_estimate(prob_higher, self.searched)
        fit = stage.fit(observed, start, is_last)
        if budget:
            possible = budget.seconds_left / (time.monotonic() - began_s)
            num = int(np.clip(possible, *config.num_refits)) if is_last else 0
            budget.report("fitting known worlds for comparison", 0.85)
            self._bootstrap = stage.bootstrap(observed, fit, start, num, self._worlds.rng, is_last)
        assert self._bootstrap is not None, "made in a round"
        ranges = (self.searched, self.first)
        return conclude(prob_higher, fit, self._bootstrap, *ranges, config.range_update)

    def _episodes_per_world(self, real: list[Trajectory]) -> int:
        return min(self.config.episodes_per_world, len(real))

    def tensors(self) -> dict[str, torch.Tensor]:
        parts = {"detector": self.model.detector, "posterior_net": self.model.posterior_net}
        tensors = {f"{p}.{k}": v for p, m in parts.items() for k, v in m.state_dict().items()}
        return tensors | {"generator": self.model.generator.get_state()}

    def state(self) -> dict[str, Any]:
        ranges = {k: getattr(self.distribution, k).tolist() for k in ("mean", "low", "high")}
        rng = self._worlds.rng.bit_generator.state
        return {"num_rounds": self.num_rounds, "distribution": ranges, "rng": rng}

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        load_weights(self.model.detector, under("detector.", tensors), "detector")
        load_weights(self.model.posterior_net, under("posterior_net.", tensors), "posterior_net")
        self.model.generator.set_state(tensors["generator"])
        self.num_rounds = state["num_rounds"]
        ranges = {k: np.array(v) for k, v in state["distribution"].items()}
        self.distribution = self.distribution.with_interval(**ranges)
        self._worlds.rng.bit_generator.state = state["rng"]
