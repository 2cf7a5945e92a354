"""The posterior SPM: the detector on single frames, then a posterior network over all that was seen and done.

Both answer the paper's question, "is the truth higher than this candidate?" (Sec. IV-A); as a
function of the candidate the answer is the survival curve of the marginal posterior.

Rendering is what costs and physics is nearly free, so only a part of the simulated steps is
drawn: enough to teach the detector, and to measure its errors on worlds it was not taught on. The
judge learns from the true keypoints of all steps, spoilt by such measured errors.
"""

from dataclasses import dataclass, field

import numpy as np
import torch

from simtune.networks import seeded
from simtune.progress import Progress
from simtune.randomization import Distribution
from simtune.search_param_model.posterior_net import (
    PosteriorNet,
    PosteriorNetConfig,
    SurvivalMixture,
    posterior_loss,
)
from simtune.search_param_model.simulated import SimulatedWorlds
from simtune.trajectory import Trajectory
from simtune.vision.detector import Detections, DetectorConfig, KeypointDetector, detect, to_input


@dataclass(frozen=True, kw_only=True)
class PosteriorConfig:
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    posterior_net: PosteriorNetConfig = field(default_factory=PosteriorNetConfig)


class PosteriorSearchParamModel:
    """q_φ, read on a grid of candidates: see the module's docstring."""

    def __init__(
        self,
        num_keypoints: int,
        action_scale: np.ndarray,
        visible: np.ndarray,
        image_size: int,
        config: PosteriorConfig,
        seed: int,
    ):
        """`action_scale`: (A,); `visible`: (N,) bool, what a single picture can show."""
        self.config = config
        self.visible = np.flatnonzero(visible)
        self.generator = torch.Generator().manual_seed(seed)
        self._action_scale = torch.tensor(action_scale, dtype=torch.float32)
        with seeded(seed):
            self.detector = KeypointDetector(
                num_keypoints, len(self.visible), image_size, config.detector
            )
            num_seen = 2 * num_keypoints + len(action_scale)
            self.posterior_net = PosteriorNet(
                num_seen, self.visible.tolist(), len(visible), config.posterior_net
            )
        self.detector.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._scale_px = image_size / 8

    def train_detector(
        self, worlds: SimulatedWorlds, distribution: Distribution, progress: Progress
    ) -> float:
        """Teach the detector on the filmed frames of `worlds`; the last updates' mean loss."""
        config = self.config.detector
        space = distribution.space
        unit = space.to_unit(worlds.parameters)[:, self.visible]
        low, high = space.to_unit(distribution.low), space.to_unit(distribution.high)
        width = torch.tensor((high - low)[self.visible], dtype=torch.float32)
        num_filmed = worlds.frames.shape[1]
        frames = worlds.frames.reshape(-1, *worlds.frames.shape[2:])
        keypoints = torch.from_numpy(worlds.filmed_keypoints()).flatten(0, 1)
        visible = torch.tensor(unit, dtype=torch.float32).repeat_interleave(num_filmed, 0)
        optimizer = torch.optim.AdamW(self.detector.parameters(), config.learning_rate)
        losses = []
        while progress.fraction() < 1:
            optimizer.param_groups[0]["lr"] = progress.learning_rate(config.learning_rate)
            at = torch.randint(len(frames), (config.batch_size,), generator=self.generator)
            pictures = to_input(frames[at.numpy()])
            pictures += 2 * config.noise * torch.randn(pictures.shape, generator=self.generator)
            loss = self.detector.loss(pictures, keypoints[at], visible[at], width)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.item())
            progress.step()
        return float(np.mean(losses[-50:]))

    def detect(self, worlds: SimulatedWorlds) -> Detections:
        """What the detector makes of all of the worlds' frames, one world after the other."""
        return detect(self.detector, worlds.frames.reshape(-1, *worlds.frames.shape[2:]))

    def detector_errors(
        self, worlds: SimulatedWorlds, seen: Detections, distribution: Distribution
    ) -> tuple[np.ndarray, np.ndarray]:
        """What it got wrong: (W, F, L, 2) pixels and (W, V) in coordinates of the range.

        `seen`: by `look_at` these worlds.
        """
        num_worlds, num_filmed = worlds.frames.shape[:2]
        found = seen.keypoints.reshape(num_worlds, num_filmed, -1, 2)
        estimated = seen.visible.reshape(num_worlds, num_filmed, -1).mean(1)
        truth = self._to_range(worlds.parameters, distribution)[:, self.visible]
        return found - worlds.filmed_keypoints(), self._from_detector(
            estimated, distribution
        ) - truth

    def train_posterior_net(
        self,
        worlds: SimulatedWorlds,
        distribution: Distribution,
        errors: tuple[np.ndarray, np.ndarray],
        progress: Progress,
    ) -> float:
        """Teach the posterior network on sets of episodes of one world; the last updates' mean loss."""
        config = self.config.posterior_net
        self.posterior_net.most_episodes.fill_(worlds.actions.shape[1])
        batches = _PosteriorBatches(worlds, errors, self.visible, config, self.generator)
        truth = torch.tensor(self._to_range(worlds.parameters, distribution), dtype=torch.float32)
        optimizer = torch.optim.AdamW(
            self.posterior_net.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        losses = []
        while progress.fraction() < 1:
            optimizer.param_groups[0]["lr"] = progress.learning_rate(config.learning_rate)
            at, keypoints, actions, visible = batches.draw(truth)
            curves = self.posterior_net(self._seen(keypoints, actions), visible)
            loss = posterior_loss(curves, truth[at], config.candidates, self.generator)
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.posterior_net.parameters(), 1.0)
            optimizer.step()
            losses.append(loss.item())
            progress.step()
        return float(np.mean(losses[-50:]))

    @torch.no_grad()
    def curves(self, trajectories: list[Trajectory], distribution: Distribution) -> SurvivalMixture:
        """The survival curves (1, N) of trajectories of one world, in coordinates of the range."""
        steps = min(len(t) for t in trajectories)
        keypoints, visible = [], []
        for trajectory in trajectories:
            found = detect(self.detector, trajectory.frames)
            keypoints.append(found.keypoints[: steps + 1])
            visible.append(found.visible.mean(0))
        seen = torch.from_numpy(np.stack(keypoints))[None]
        actions = torch.from_numpy(np.stack([t.actions[:steps] for t in trajectories]))[None]
        pooled = self._from_detector(np.mean(visible, 0), distribution)
        pooled = torch.tensor(pooled[None], dtype=torch.float32)
        return self.posterior_net(self._seen(seen, actions.float()), pooled)

    def _seen(self, keypoints: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """(B, E, T + 1, L, 2) pixels and (B, E, T, A) actions, side by side: (B, E, T, S)."""
        middle = (self.detector.cells * 2 - 1) / 2
        places = (keypoints[:, :, :-1].flatten(-2) - middle) / self._scale_px
        return torch.cat([places, actions / self._action_scale], -1)

    def _to_range(self, parameters: np.ndarray, distribution: Distribution) -> np.ndarray:
        return 2 * distribution.to_local(parameters) - 1

    def _from_detector(self, estimated: np.ndarray, distribution: Distribution) -> np.ndarray:
        """(..., V) the detector's coordinates of the whole space to coordinates of the range."""
        space = distribution.space
        low = space.to_unit(distribution.low)[self.visible]
        high = space.to_unit(distribution.high)[self.visible]
        return 2 * (estimated - low) / (high - low) - 1


class _PosteriorBatches:
    """Sets of episodes as the detector would have seen them: truth plus errors of another world.

    The errors of one world go with each other (its colours mislead the detector everywhere), so a set
    takes all of its errors from one world.
    """

    def __init__(self, worlds: SimulatedWorlds, errors, visible: np.ndarray, config, generator):
        self._keypoints = torch.from_numpy(worlds.keypoints)
        self._actions = torch.from_numpy(worlds.actions).float()
        self._errors = torch.from_numpy(errors[0]).float()  # (R, F, L, 2)
        self._visible_errors = torch.from_numpy(errors[1]).float()  # (R, V)
        self._visible = torch.from_numpy(visible)
        self._config, self._generator = config, generator

    def draw(self, truth: torch.Tensor):
        """World indices (B,), keypoints (B, E', T' + 1, L, 2), actions, visible (B, V)."""
        num_worlds, num_episodes, num_steps, _ = self._actions.shape
        worlds = self._random(num_worlds, self._config.batch_size)
        count = 1 + self._random(num_episodes, 1).item()
        episodes = torch.randperm(num_episodes, generator=self._generator)[:count]
        # Few different lengths: what convolutions keep of each shape adds up in memory.
        shortest = min(self._config.shortest_crop, num_steps)
        lengths = torch.linspace(shortest, num_steps, self._config.crop_lengths).long()
        length = int(lengths[self._random(len(lengths), 1)].item())
        start = self._random(num_steps - length + 1, 1).item()
        keypoints = self._keypoints[worlds][:, episodes, start : start + length + 1]
        actions = self._actions[worlds][:, episodes, start : start + length]
        misled = self._random(len(self._errors), len(worlds))
        keypoints = keypoints + self._stretched(misled, int(count), int(length) + 1)
        visible = truth[worlds][:, self._visible] + self._visible_errors[misled]
        return worlds, keypoints, actions, visible

    def _stretched(self, worlds: torch.Tensor, episodes: int, length: int) -> torch.Tensor:
        """Successive errors of `worlds` for each episode, in turn from a random one on."""
        num_filmed = self._errors.shape[1]
        start = torch.randint(num_filmed, (len(worlds), episodes, 1), generator=self._generator)
        at = (start + torch.arange(length)) % num_filmed
        return self._errors[worlds[:, None, None], at]

    def _random(self, high: int, num: int) -> torch.Tensor:
        return torch.randint(int(high), (num,), generator=self._generator)
