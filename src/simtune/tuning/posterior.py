"""search="posterior": straight to the median, narrow the range, collect again."""

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from simtune.errors import InputError
from simtune.progress import Say, silent
from simtune.randomization import Distribution
from simtune.search_param_model.judge import SHORTEST_STEPS
from simtune.search_param_model.posterior import (
    PosteriorConfig,
    PosteriorSearchParamModel,
    Progress,
)
from simtune.search_param_model.simulated import (
    PILOT_STEPS,
    SimulatedWorlds,
    find_landmarks,
    simulate,
)
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.moves import MoveConfig, candidate_grid, move, read_curves
from simtune.tuning.search import Estimate, Event

_FEWEST_WORLDS = 64  # to learn anything from


@dataclass(frozen=True, kw_only=True)
class PosteriorSearchConfig:
    model: PosteriorConfig = field(default_factory=PosteriorConfig)
    move: MoveConfig = field(default_factory=MoveConfig)
    num_worlds: int = 256  # simulated in an iteration
    episodes_per_world: int = 4  # at most, of the real ones, whose actions they replay
    filmed_steps: int = 32  # successive frames drawn of each world
    held_out: float = 0.25  # share of the worlds on which sight's errors are measured
    iterations: int = 3
    sight_updates: tuple[int, ...] = (2500, 1200)  # first iteration, later ones
    judge_updates: int = 1200
    least_updates: int = 200  # of each, however late it is
    time_shares: tuple[float, ...] = (0.45, 0.3, 0.25)  # of the time, for each iteration
    collect_share: float = 0.4  # of an iteration's time, at most, goes into simulating
    sight_share: float = 0.6  # of an iteration's training time


class PosteriorSearch:
    """Search by the posterior SPM; a `tuning.search.Search`."""

    def __init__(
        self,
        simulator: Simulator,
        camera: str,
        start: np.ndarray,
        config: PosteriorSearchConfig | None = None,
        *,
        seed: int,
        say: Say = silent,
    ):
        self.config = config = config or PosteriorSearchConfig()
        self.simulator, self._say = simulator, say
        self.first = Distribution.first(simulator.space, start)
        self.distribution = self.first
        self.iteration = 0
        self._rng = np.random.default_rng(seed)
        began_s = time.monotonic()
        self._landmarks = find_landmarks(simulator, camera, self.first, seed)
        self._seconds_per_step = max(1e-9, (time.monotonic() - began_s) / PILOT_STEPS)
        self.model = PosteriorSearchParamModel(
            len(self._landmarks),
            simulator.action_scale,
            simulator.space.is_visible,
            simulator.image_size,
            config.model,
            seed,
        )

    @property
    def finished(self) -> bool:
        return self.iteration >= self.config.iterations

    def check(self, real: list[Trajectory]) -> None:
        """Raises InputError where there are no trajectories, or too short ones."""
        steps = min((len(t) for t in real), default=0)
        if steps < SHORTEST_STEPS:
            raise InputError(
                f"search='posterior' needs episodes of at least {SHORTEST_STEPS} steps, "
                + (f"got one of {steps}" if real else "got none")
            )

    def iterate(
        self, real: list[Trajectory], deadline_s: float
    ) -> tuple[Estimate, list[Event], dict[str, float]]:
        """Simulate in Ξ with the real actions, train sight and judge, look, move Ξ."""
        end_s = self._end_of_iteration(deadline_s)
        self._now("simulating and filming", 0.0)
        worlds = self._collect(real, self._affordable_worlds(real, end_s))
        losses = self._train(worlds, end_s)
        curves = self.model.curves(real, self.distribution)
        grid = torch.tensor(candidate_grid(), dtype=torch.float32).expand(
            1, len(self.first.mean), -1
        )
        prob_higher = curves.prob_higher(grid)[0].numpy()
        estimate = read_curves(prob_higher, self.distribution, self.first, self.config.move)
        self.distribution, events = move(
            prob_higher, self.distribution, self.first, self.config.move
        )
        self.iteration += 1
        return estimate, events, losses

    def _now(self, doing: str, share: float) -> None:
        """Say what is done, and how much of the present iteration is over."""
        count = self.config.iterations
        done = (min(self.iteration, count - 1) + share) / count
        self._say(f"{min(self.iteration + 1, count)}/{count} {doing}", done)

    def _end_of_iteration(self, deadline_s: float) -> float:
        shares = self.config.time_shares[self.iteration :] or (1.0,)
        now = time.monotonic()
        return now + max(0.0, deadline_s - now) * shares[0] / sum(shares)

    def _affordable_worlds(self, real: list[Trajectory], end_s: float) -> int:
        """As many as the config says, or fewer where they would take most of the iteration."""
        seconds = self.config.collect_share * (end_s - time.monotonic())
        steps = min(len(t) for t in real) * min(self.config.episodes_per_world, len(real))
        affordable = seconds / (self._seconds_per_step * steps)
        return int(
            np.clip(affordable, min(_FEWEST_WORLDS, self.config.num_worlds), self.config.num_worlds)
        )

    def _collect(self, real: list[Trajectory], num_worlds: int) -> SimulatedWorlds:
        """Worlds drawn from Ξ replay the real actions; a stretch of each is filmed."""
        began_s = time.monotonic()
        config, rng = self.config, self._rng
        steps = min(len(t) for t in real)
        played = np.stack([t.actions[:steps] for t in real])
        episodes = min(config.episodes_per_world, len(real))
        which = np.stack([rng.permutation(len(real))[:episodes] for _ in range(num_worlds)])
        parameters = self.distribution.sample(num_worlds, rng)
        # Supersampled pictures cost more: fewer of them.
        filmed = max(1, config.filmed_steps // self.simulator.supersampling)
        worlds = simulate(self.simulator, self._landmarks, parameters, played[which], filmed, rng)
        self._seconds_per_step = (time.monotonic() - began_s) / (num_worlds * episodes * steps)
        return worlds

    def _train(self, worlds: SimulatedWorlds, end_s: float) -> dict[str, float]:
        config, model = self.config, self.model
        seconds = max(1.0, end_s - time.monotonic())
        num_taught = round(len(worlds.parameters) * (1 - config.held_out))
        updates = config.sight_updates[min(self.iteration, len(config.sight_updates) - 1)]
        taught, others = worlds.split(num_taught)
        progress = Progress(
            updates,
            seconds * config.sight_share,
            lambda f: self._now("learning to see", 0.2 + 0.5 * f),
            config.least_updates,
        )
        sight_loss = model.train_sight(taught, self.distribution, progress)
        errors = model.sight_errors(others, self.distribution)
        progress = Progress(
            config.judge_updates,
            max(1.0, end_s - time.monotonic()),
            lambda f: self._now("learning to judge", 0.7 + 0.3 * f),
            config.least_updates,
        )
        judge_loss = model.train_judge(worlds, self.distribution, errors, progress)
        return {
            "loss/sight": sight_loss,
            "loss/judge": judge_loss,
            "sight/error_px": float(np.median(np.abs(errors[0]))) if errors[0].size else 0.0,
        }

    def tensors(self) -> dict[str, torch.Tensor]:
        parts = {"sight": self.model.sight, "judge": self.model.judge}
        tensors = {f"{p}.{k}": v for p, m in parts.items() for k, v in m.state_dict().items()}
        return tensors | {"generator": self.model.generator.get_state()}

    def state(self) -> dict[str, Any]:
        ranges = {k: getattr(self.distribution, k).tolist() for k in ("mean", "low", "high")}
        return {
            "iteration": self.iteration,
            "distribution": ranges,
            "landmarks": [self._landmarks.geoms.tolist(), self._landmarks.offsets.tolist()],
            "rng": self._rng.bit_generator.state,
        }

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        # What the networks were taught on, should another machine choose others.
        geoms, offsets = (np.array(x) for x in state["landmarks"])
        if len(geoms) != len(self._landmarks):
            raise RuntimeError("the run was made with other landmarks; start another one")
        self._landmarks = replace(self._landmarks, geoms=geoms, offsets=offsets.reshape(-1, 3))
        for part, module in (("sight", self.model.sight), ("judge", self.model.judge)):
            prefix = part + "."
            own = {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
            module.load_state_dict(own)
        self.model.generator.set_state(tensors["generator"])
        self.iteration = state["iteration"]
        ranges = {k: np.array(v) for k, v in state["distribution"].items()}
        self.distribution = self.distribution.with_interval(**ranges)
        self._rng.bit_generator.state = state["rng"]
