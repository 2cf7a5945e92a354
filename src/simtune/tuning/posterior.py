"""search="posterior": straight to the median, narrow the range, collect again."""

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from simtune.budget import Budget
from simtune.errors import InputError
from simtune.fit import (
    Bootstrap,
    FitResult,
    ReplayFit,
    correlations,
    doubts,
    in_range,
    inflate,
    num_fitted,
    ranks,
    run_bootstrap,
)
from simtune.networks import load_weights, under
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.search_param_model.posterior_net import SHORTEST_STEPS
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.lessons import Lessons
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.range_update import candidate_grid, guess, move, read_curves, with_fit
from simtune.tuning.search import Estimate, Round, SearchContext


class PosteriorSearch:
    """Search by the posterior SPM; a `tuning.search.Search`."""

    def __init__(
        self,
        context: SearchContext,
        config: PosteriorSearchConfig | None = None,
    ):
        self.config = config = config or PosteriorSearchConfig()
        self.simulator = simulator = context.simulator
        self._budget = Budget()
        self.first = Distribution.first(simulator.space, context.start)
        self.distribution = self.first
        self.searched = self.first  # by the last iteration: what its curves are in terms of
        self.iteration = 0
        self._lessons = Lessons(context, config, self._now)
        self._has_iterated = False
        self._replay: ReplayFit | None = None
        self._replicas: Bootstrap | None = None

    @property
    def model(self) -> PosteriorSearchParamModel:
        return self._lessons.model

    @property
    def finished(self) -> bool:
        return self.iteration >= self.config.iterations

    def check(self, real: list[Trajectory]) -> None:
        """Raises InputError where there are no trajectories, or too short ones."""
        steps = min((len(t) for t in real), default=0)
        if steps < SHORTEST_STEPS:
            raise InputError(
                f"--search posterior needs episodes of at least {SHORTEST_STEPS} steps, "
                + (f"got one of {steps}" if real else "got none")
            )

    def run_round(self, real: list[Trajectory], budget: Budget) -> Round:
        """Simulate in Ξ with the real actions, learn to see and judge, look, fit, move Ξ."""
        self._budget, deadline_s = budget, time.monotonic() + budget.seconds_left
        end_s = self._end_of_iteration(deadline_s)
        seconds = max(1.0, end_s - time.monotonic())
        self.searched = self.distribution
        self._replay, losses = self._lessons.teach(real, self.searched, self.iteration, seconds)
        estimate, prob_higher = self._look(real, end_s, deadline_s)
        self.distribution, events = move(
            prob_higher, self.distribution, self.first, self.config.move
        )
        self.iteration += 1
        self._has_iterated = True
        return Round(estimate, events, losses)

    def look(self, trajectories: list[Trajectory]) -> tuple[Estimate, np.ndarray]:
        """What the last iteration would have made of other trajectories; and (N, C) curves.

        The curves are on `candidate_grid`, in coordinates of the range `searched`. Raises
        RuntimeError for a search that was loaded and has not iterated since.
        """
        if not self._has_iterated:
            raise RuntimeError("what a fit learnt is in no checkpoint: iterate first")
        return self._look(trajectories)

    def _now(self, doing: str, share: float) -> None:
        """Say what is done, and how much of the present iteration is over."""
        count = self.config.iterations
        done = (min(self.iteration, count - 1) + share) / count
        self._budget.report(f"{min(self.iteration + 1, count)}/{count} {doing}", done)

    def _end_of_iteration(self, deadline_s: float) -> float:
        shares = self.config.time_shares[self.iteration :] or (1.0,)
        now = time.monotonic()
        return now + max(0.0, deadline_s - now) * shares[0] / sum(shares)

    def _look(
        self,
        trajectories: list[Trajectory],
        end_s: float | None = None,
        deadline_s: float = math.inf,
    ) -> tuple[Estimate, np.ndarray]:
        """Judge and fit; with `end_s` replicas are made until then, to know what to think of it.

        They are in the last iteration, which is this one where the deadline has come.
        """
        began_s = time.monotonic()
        if self._replay is None:
            prob_higher = self._read_posterior_net(trajectories)
            return self._read(prob_higher), prob_higher
        prob_higher = self._read_posterior_net(trajectories[: num_fitted(len(trajectories))])
        steps = min(len(t) for t in trajectories)
        frames = [t.frames[: steps + 1] for t in trajectories]  # no copy: there may be many
        actions = np.stack([t.actions[:steps] for t in trajectories]).astype(float)
        start, std = guess(prob_higher, self.searched)
        self._now("fitting", 0.8)
        grow = self.iteration >= self.config.iterations - 1  # what is fitted once more can wait
        found = self._replay.fit(frames, actions, start, std, self._lag, grow)
        if end_s is not None:
            left_s, fit_s = end_s - time.monotonic(), time.monotonic() - began_s
            is_last = grow or time.monotonic() > deadline_s
            num = int(np.clip(left_s / fit_s, *self.config.replicas)) if is_last else 0
            self._now("fitting known worlds for comparison", 0.85)
            simulator, noise, rng = self.simulator, self._lessons.image_noise, self._lessons.rng
            assert isinstance(simulator, Simulator), "only those are fitted"
            self._replicas = run_bootstrap(
                self._replay, simulator, found, actions, num, start, std, noise, rng, grow
            )
        assert self._replicas is not None, "an iteration comes first"
        return self._conclude(prob_higher, found, self._replicas)

    @property
    def _lag(self) -> int | None:
        """Known to be 0, or (None) to be found."""
        is_tuned = self.simulator.space.is_delay.any()
        return None if self._lessons.image_noise and not is_tuned else 0

    def _read_posterior_net(self, trajectories: list[Trajectory]) -> np.ndarray:
        """(N, C) the posterior network's survival curves on the grid."""
        curves = self.model.curves(trajectories, self.searched)
        grid = torch.tensor(candidate_grid(), dtype=torch.float32)
        return curves.prob_higher(grid.expand(1, len(self.first.mean), -1))[0].numpy()

    def _read(self, prob_higher: np.ndarray) -> Estimate:
        return read_curves(prob_higher, self.searched, self.first, self.config.move)

    def _conclude(
        self, prob_higher: np.ndarray, found: FitResult, replicas: Bootstrap
    ) -> tuple[Estimate, np.ndarray]:
        """The estimate and its (N, C) curves: those of the fit, with the posterior network's for tails."""
        names = self.simulator.space.names
        mean, std = in_range(
            inflate(found, replicas, self._lessons.image_noise is None), self.searched
        )
        prob_higher = with_fit(prob_higher, mean, std, self.config.move)
        estimate = replace(
            self._read(prob_higher),
            correlations=correlations(found, names),
            ranks=ranks(replicas, names),
            warnings=doubts(found, replicas),
            start=found.start.tolist(),
            lag=found.lag,
        )
        return estimate, prob_higher

    def tensors(self) -> dict[str, torch.Tensor]:
        parts = {"detector": self.model.detector, "posterior_net": self.model.posterior_net}
        tensors = {f"{p}.{k}": v for p, m in parts.items() for k, v in m.state_dict().items()}
        return tensors | {"generator": self.model.generator.get_state()}

    def state(self) -> dict[str, Any]:
        ranges = {k: getattr(self.distribution, k).tolist() for k in ("mean", "low", "high")}
        return {
            "iteration": self.iteration,
            "distribution": ranges,
            "keypoints": self._lessons.keypoints.state(),
            "rng": self._lessons.rng.bit_generator.state,
        }

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        # What the networks were taught on, should another machine choose others.
        keypoints = self._lessons.keypoints.with_state(state["keypoints"])
        if len(keypoints) != len(self._lessons.keypoints):
            raise RuntimeError("the run was made with other keypoints; start another one")
        self._lessons.keypoints = keypoints
        for part, module in (
            ("detector", self.model.detector),
            ("posterior_net", self.model.posterior_net),
        ):
            load_weights(module, under(f"{part}.", tensors), part)
        self.model.generator.set_state(tensors["generator"])
        self.iteration = state["iteration"]
        ranges = {k: np.array(v) for k, v in state["distribution"].items()}
        self.distribution = self.distribution.with_interval(**ranges)
        self._lessons.rng.bit_generator.state = state["rng"]
