"""What a posterior search learns in an iteration: to see, to judge, to follow.

Each lesson takes worlds of the range that is searched at present, and a share of the time.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from simtune.errors import InputError
from simtune.fit import ReplayFit, fit_to_budget
from simtune.progress import Progress
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.search_param_model.simulated import SimulatedWorlds, simulate
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import SearchContext
from simtune.vision.detector import Detections
from simtune.vision.image_noise import ImageNoise
from simtune.vision.keypoints import Keypoints

_FEWEST_WORLDS = 64  # to learn anything from


class Lessons:
    """The simulator as a school of the SPM; keeps how long a simulated step takes."""

    def __init__(
        self,
        context: SearchContext,
        config: PosteriorSearchConfig,
        now: Callable[[str, float], None],
    ):
        """`now(doing, share)` is told what is done, and how much of the iteration is over."""
        self.simulator, self._config, self._now = context.simulator, config, now
        simulator, seed = context.simulator, context.seed
        self.image_noise = None if context.looks_alike else ImageNoise()
        self.rng = np.random.default_rng(seed)
        self._seed = seed
        self.keypoints = context.keypoints
        hidden = [p.name for p in simulator.space if not p.is_visible]
        if hidden and not len(self.keypoints):
            raise InputError(
                f"{hidden[0]} shows in motion only, and nothing moves in the simulator's episodes: "
                "have them start elsewhere, act, or leave the parameter out"
            )
        # Of a simulated step, and of a picture
        self._step_s = 1e-4
        self._frame_s = 0.0
        self.model = PosteriorSearchParamModel(
            len(self.keypoints),
            simulator.action_scale,
            simulator.space.is_visible,
            simulator.image_size,
            config.model,
            seed,
        )

    def teach(
        self, real: list[Trajectory], distribution: Distribution, iteration: int, seconds: float
    ) -> tuple[ReplayFit | None, dict[str, float]]:
        """All of them: what follows motions from now on, where anything moves; and losses."""
        config = self._config
        self._now("simulating and filming", 0.0)
        collect_s = seconds * config.collect_share
        episodes = min(config.episodes_per_world, len(real))
        worlds = self._collect(
            real, distribution, config.num_worlds, episodes, config.filmed_steps, collect_s
        )
        losses = self._to_see(worlds, distribution, iteration, seconds * config.detector_share)
        worlds = replace(worlds, frames=worlds.frames[:0].copy())  # makes room for others
        unseen = self._collect(
            real, distribution, config.unseen_worlds, 1, config.unseen_steps, collect_s
        )
        seen = self.model.detect(unseen)
        errors = self.model.detector_errors(unseen, seen, distribution)
        times = 1 if self._scene else config.no_fit_scale
        if times > 1:  # hardly filmed: what they looked like is known from others
            most = config.num_worlds * times
            worlds = self._collect(real, distribution, most, episodes, 2, collect_s)
        posterior_s = seconds * config.posterior_share * times
        losses |= self._train_posterior_net(worlds, errors, distribution, times, posterior_s)
        num_steps = min(len(t) for t in real) * len(real)
        return self._to_follow(unseen, seen, distribution, num_steps, seconds), losses

    @property
    def _scene(self) -> tuple[Simulator, Keypoints] | None:
        """What can be fitted: it begins anywhere, as environments need not, and something moves."""
        simulator, keypoints = self.simulator, self.keypoints
        if not isinstance(simulator, Simulator) or not isinstance(keypoints, Keypoints):
            return None
        return (simulator, keypoints) if len(keypoints) else None

    def _collect(
        self,
        real: list[Trajectory],
        distribution: Distribution,
        most: int,
        episodes: int,
        filmed: int,
        seconds: float,
    ) -> SimulatedWorlds:
        """Worlds drawn from Ξ replay the real actions of so many episodes; a stretch is `filmed`.

        `most` worlds, or fewer where they would take longer than `seconds`.
        """
        rng, steps = self.rng, min(len(t) for t in real)
        filmed = max(2, filmed // self.simulator.supersampling)  # which makes pictures dear
        world_s = self._step_s * episodes * steps + self._frame_s * filmed
        num_worlds = int(np.clip(seconds / world_s, min(_FEWEST_WORLDS, most), most))
        began_s = time.monotonic()
        played = np.stack([t.actions[:steps] for t in real])
        which = np.stack([rng.permutation(len(real))[:episodes] for _ in range(num_worlds)])
        worlds = simulate(
            self.simulator,
            self.keypoints,
            distribution.sample(num_worlds, rng),
            played[which],
            filmed,
            rng,
            self.image_noise,
        )
        world_s = (time.monotonic() - began_s) / num_worlds
        self._step_s = min(self._step_s, world_s / (episodes * steps))
        self._frame_s = (world_s - self._step_s * episodes * steps) / filmed
        return worlds

    def _progress(
        self, updates: int, seconds: float, doing: str, start: float, end: float
    ) -> Progress:
        def tell(fraction: float) -> None:
            self._now(doing, start + (end - start) * fraction)

        return Progress(updates, seconds, tell, self._config.least_updates)

    def _to_see(
        self, worlds: SimulatedWorlds, distribution: Distribution, iteration: int, seconds: float
    ) -> dict[str, float]:
        counts = self._config.detector_updates
        updates = counts[min(iteration, len(counts) - 1)]
        progress = self._progress(updates, seconds, "learning to see", 0.1, 0.6)
        return {"loss/detector": self.model.train_detector(worlds, distribution, progress)}

    def _train_posterior_net(
        self,
        worlds: SimulatedWorlds,
        errors: tuple[np.ndarray, np.ndarray],
        distribution: Distribution,
        times: int,
        seconds: float,
    ) -> dict[str, float]:
        """With so many `times` the usual updates."""
        updates = self._config.posterior_updates * times
        progress = self._progress(updates, seconds, "learning to judge", 0.6, 0.7)
        loss = self.model.train_posterior_net(worlds, distribution, errors, progress)
        error_px = float(np.median(np.abs(errors[0]))) if errors[0].size else 0.0
        return {"loss/posterior_net": loss, "detector/error_px": error_px}

    def _to_follow(
        self,
        unseen: SimulatedWorlds,
        seen: Detections,
        distribution: Distribution,
        num_steps: int,
        seconds: float,
    ) -> ReplayFit | None:
        """`num_steps`: of all real episodes together."""
        config, scene = self._config, self._scene
        if scene is None:
            return None
        particles, shooting = fit_to_budget(
            config.particles,
            config.shooting,
            *scene,
            distribution.mean,
            num_steps,
            seconds * config.fit_share,
        )
        replay = ReplayFit(*scene, self.model.detector, self._seed, particles, shooting)
        seconds *= config.state_share
        progress = self._progress(config.state_updates, seconds, "learning to follow", 0.7, 0.8)
        replay.learn(unseen, seen, progress)
        return replay
