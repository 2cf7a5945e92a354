"""search="posterior": straight to the median, narrow the range, collect again."""

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from simtune.errors import InputError
from simtune.fit import (
    Fit,
    ReplayFit,
    Replicas,
    ShootingConfig,
    affordable,
    correlations,
    doubts,
    in_range,
    num_fitted,
    ranks,
    widened,
)
from simtune.progress import Progress, Say, silent
from simtune.randomization import Distribution
from simtune.search_param_model.judge import SHORTEST_STEPS
from simtune.search_param_model.posterior import (
    PosteriorConfig,
    PosteriorSearchParamModel,
)
from simtune.search_param_model.simulated import (
    PILOT_STEPS,
    Camera,
    SimulatedWorlds,
    find_landmarks,
    simulate,
)
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.moves import MoveConfig, candidate_grid, guess, move, read_curves, with_fit
from simtune.tuning.search import Estimate, Event

_FEWEST_WORLDS = 64  # to learn anything from


@dataclass(frozen=True, kw_only=True)
class PosteriorSearchConfig:
    model: PosteriorConfig = field(default_factory=PosteriorConfig)
    move: MoveConfig = field(default_factory=MoveConfig)
    shooting: ShootingConfig = field(default_factory=ShootingConfig)
    num_worlds: int = 256  # simulated in an iteration
    episodes_per_world: int = 4  # at most, of the real ones, whose actions they replay
    filmed_steps: int = 32  # successive frames drawn of each world
    unseen_worlds: int = 128  # of an iteration, that sight is not taught on but tested on
    unseen_steps: int = 64  # of each, filmed
    iterations: int = 2
    sight_updates: tuple[int, ...] = (2500, 1500)  # first iteration, later ones
    judge_updates: int = 800
    state_updates: int = 600
    least_updates: int = 200  # of each, however late it is
    time_shares: tuple[float, ...] = (0.4, 0.6)  # of the time, for each iteration
    collect_share: float = 0.25  # of an iteration's time, at most, goes into simulating
    sight_share: float = 0.42  # of an iteration's time
    judge_share: float = 0.08
    state_share: float = 0.1
    fit_share: float = 0.1  # of one fit, at most; fewer windows where physics is slow
    replicas: tuple[int, int] = (2, 8)  # worlds fitted as the real one is: at least, at most


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
        looks_alike: bool = True,
    ):
        """`looks_alike`: the real world is drawn as the simulator draws, and moves as promptly."""
        self.config = config = config or PosteriorSearchConfig()
        self.simulator, self._say = simulator, say
        self.first = Distribution.first(simulator.space, start)
        self.distribution = self.searched = self.first
        self._replicas: Replicas | None = None
        self.iteration = 0
        self._rng = np.random.default_rng(seed)
        self._camera = None if looks_alike else Camera()
        began_s = time.monotonic()
        self._seed = seed
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
        """Simulate in Ξ with the real actions, train sight and judge, look, fit, move Ξ."""
        end_s = self._end_of_iteration(deadline_s)
        config, seconds = self.config, max(1.0, end_s - time.monotonic())
        self._now("simulating and filming", 0.0)
        num_worlds = self._affordable(real, config.num_worlds, seconds * config.collect_share)
        worlds = self._collect(real, num_worlds, config.episodes_per_world, config.filmed_steps)
        losses = self._learn_to_see(worlds, seconds * config.sight_share)
        unseen = self._collect(real, config.unseen_worlds, 1, config.unseen_steps)
        losses |= self._learn_to_judge(worlds, unseen, seconds * config.judge_share)
        self._learn_to_follow(unseen, seconds)
        estimate, prob_higher = self._look(real, end_s)
        self.distribution, events = move(prob_higher, self.distribution, self.first, config.move)
        self.iteration += 1
        return estimate, events, losses

    def look(self, trajectories: list[Trajectory]) -> tuple[Estimate, np.ndarray]:
        """What the last iteration would have made of other trajectories; and (N, C) curves.

        The curves are on `candidate_grid`, in coordinates of the range `searched`.
        """
        return self._look(trajectories, None)

    def _now(self, doing: str, share: float) -> None:
        """Say what is done, and how much of the present iteration is over."""
        count = self.config.iterations
        done = (min(self.iteration, count - 1) + share) / count
        self._say(f"{min(self.iteration + 1, count)}/{count} {doing}", done)

    def _end_of_iteration(self, deadline_s: float) -> float:
        shares = self.config.time_shares[self.iteration :] or (1.0,)
        now = time.monotonic()
        return now + max(0.0, deadline_s - now) * shares[0] / sum(shares)

    def _affordable(self, real: list[Trajectory], num_worlds: int, seconds: float) -> int:
        """So many worlds, or fewer where they would take longer than `seconds`."""
        steps = min(len(t) for t in real) * min(self.config.episodes_per_world, len(real))
        affordable = seconds / (self._seconds_per_step * steps)
        return int(np.clip(affordable, min(_FEWEST_WORLDS, num_worlds), num_worlds))

    def _collect(
        self, real: list[Trajectory], num_worlds: int, episodes: int, filmed: int
    ) -> SimulatedWorlds:
        """Worlds drawn from Ξ replay the real actions; a stretch of each is filmed."""
        began_s = time.monotonic()
        rng, steps = self._rng, min(len(t) for t in real)
        played = np.stack([t.actions[:steps] for t in real])
        episodes = min(episodes, len(real))
        which = np.stack([rng.permutation(len(real))[:episodes] for _ in range(num_worlds)])
        parameters = self.distribution.sample(num_worlds, rng)
        # Supersampled pictures cost more: fewer of them.
        filmed = max(2, filmed // self.simulator.supersampling)
        worlds = simulate(
            self.simulator,
            self._landmarks,
            parameters,
            played[which],
            filmed,
            rng,
            self._camera,
        )
        self._seconds_per_step = (time.monotonic() - began_s) / (num_worlds * episodes * steps)
        return worlds

    def _progress(self, updates: int, seconds: float, doing: str, start: float, end: float):
        def tell(fraction: float) -> None:
            self._now(doing, start + (end - start) * fraction)

        return Progress(updates, seconds, tell, self.config.least_updates)

    def _learn_to_see(self, worlds: SimulatedWorlds, seconds: float) -> dict[str, float]:
        counts = self.config.sight_updates
        updates = counts[min(self.iteration, len(counts) - 1)]
        progress = self._progress(updates, seconds, "learning to see", 0.1, 0.6)
        return {"loss/sight": self.model.train_sight(worlds, self.distribution, progress)}

    def _learn_to_judge(
        self, worlds: SimulatedWorlds, unseen: SimulatedWorlds, seconds: float
    ) -> dict[str, float]:
        errors = self.model.sight_errors(unseen, self.distribution)
        updates = self.config.judge_updates
        progress = self._progress(updates, seconds, "learning to judge", 0.6, 0.7)
        loss = self.model.train_judge(worlds, self.distribution, errors, progress)
        error_px = float(np.median(np.abs(errors[0]))) if errors[0].size else 0.0
        return {"loss/judge": loss, "sight/error_px": error_px}

    def _learn_to_follow(self, unseen: SimulatedWorlds, seconds: float) -> None:
        self.searched = self.distribution
        self._replicas = None
        if not len(self._landmarks):
            return  # nothing moves
        config, scene = self.config, (self.simulator, self._landmarks)
        budget_s = seconds * config.fit_share / 2  # it is begun from two sides
        shooting = affordable(config.shooting, *scene, self.distribution.mean, budget_s)
        self._replay = ReplayFit(*scene, self.model.sight, self._seed, shooting)
        seconds *= config.state_share
        progress = self._progress(config.state_updates, seconds, "learning to follow", 0.7, 0.8)
        self._replay.learn(unseen, progress)

    def _look(
        self, trajectories: list[Trajectory], end_s: float | None
    ) -> tuple[Estimate, np.ndarray]:
        """Judge and fit; with `end_s` replicas are made until then, to know what to think of it."""
        began_s = time.monotonic()
        prob_higher = self._judge(trajectories[: num_fitted(len(trajectories))])
        if not len(self._landmarks):
            return self._read(prob_higher), prob_higher
        steps = min(len(t) for t in trajectories)
        frames = np.stack([t.frames[: steps + 1] for t in trajectories])
        actions = np.stack([t.actions[:steps] for t in trajectories]).astype(float)
        start, guess_std = guess(prob_higher, self.searched)
        self._now("fitting", 0.8)
        found = self._replay.fit(frames, actions, start, guess_std, self._lag)
        if end_s is not None:
            num = self._affordable_replicas(end_s, time.monotonic() - began_s)
            self._now("fitting known worlds for comparison", 0.85)
            self._replicas = self._replay.replicas(
                found, actions, num, guess_std, self._camera, self._rng
            )
        assert self._replicas is not None, "an iteration comes first"
        return self._conclude(prob_higher, found, self._replicas)

    @property
    def _lag(self) -> int | None:
        """Known to be 0, or (None) to be found."""
        is_tuned = any(p.is_delay for p in self.simulator.space)
        return None if self._camera and not is_tuned else 0

    def _affordable_replicas(self, end_s: float, fit_s: float) -> int:
        """None before the last iteration: what is fitted once more needs no test."""
        if self.iteration < self.config.iterations - 1:
            return 0
        return int(np.clip((end_s - time.monotonic()) / fit_s, *self.config.replicas))

    def _judge(self, trajectories: list[Trajectory]) -> np.ndarray:
        """(N, C) the judge's survival curves on the grid."""
        curves = self.model.curves(trajectories, self.searched)
        grid = torch.tensor(candidate_grid(), dtype=torch.float32)
        return curves.prob_higher(grid.expand(1, len(self.first.mean), -1))[0].numpy()

    def _read(self, prob_higher: np.ndarray) -> Estimate:
        return read_curves(prob_higher, self.searched, self.first, self.config.move)

    def _conclude(
        self, prob_higher: np.ndarray, found: Fit, replicas: Replicas
    ) -> tuple[Estimate, np.ndarray]:
        """The estimate and its (N, C) curves: those of the fit, with the judge's for tails."""
        names = self.simulator.space.names
        mean, std = in_range(widened(found, replicas, self._camera is None), self.searched)
        prob_higher = with_fit(prob_higher, mean, std, self.config.move)
        estimate = replace(
            self._read(prob_higher),
            correlations=correlations(found, names),
            ranks=ranks(replicas, names),
            warnings=doubts(found, replicas),
        )
        return estimate, prob_higher

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
