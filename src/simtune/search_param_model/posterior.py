"""The posterior SPM: a keypoint detector on single frames, then a network over whole episodes.

Both answer the paper's question, "is the truth higher than this candidate?" (Sec. IV-A); as a
function of the candidate the answer is the survival curve of the marginal posterior.

Rendering is expensive and physics nearly free, so only a part of the simulated steps is drawn:
enough to train the detector, and to measure its errors in held-out worlds. The posterior network
learns from the true keypoints of all steps, with errors added that were measured in similar poses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch

from simtune.networks.cuda_graph import CALLS_BEFORE_REPLAY, Step, graphed
from simtune.networks.layers import load_generator, load_weights, seeded, under
from simtune.networks.training import TrainingClock, train_network
from simtune.randomization import Distribution
from simtune.search_param_model.posterior_batches import DetectorErrors, PosteriorBatches
from simtune.search_param_model.posterior_net import (
    PosteriorNet,
    PosteriorNetConfig,
    SurvivalMixture,
    posterior_loss,
)
from simtune.search_param_model.simulated import FilmedWorlds, SimulatedWorlds
from simtune.search_param_model.training_pictures import TrainingPictures
from simtune.vision.detector import (
    Detections,
    DetectorConfig,
    KeypointDetector,
    detect,
    to_input,
)

_LARGEST_GRADIENT = 1.0  # of the posterior network, as a norm


@dataclass(frozen=True, kw_only=True)
class PosteriorConfig:
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    posterior_net: PosteriorNetConfig = field(default_factory=PosteriorNetConfig)


class PosteriorSearchParamModel:
    """q_φ, evaluated on a grid of candidates: see the module's docstring."""

    def __init__(
        self,
        num_keypoints: int,
        action_scale: np.ndarray,
        visible: np.ndarray,
        shape: tuple[int, int],
        config: PosteriorConfig,
        seed: int,
        device: torch.device | str = "cpu",
    ):
        """`action_scale`: (A,); `visible`: (N,) bool, what a single picture can show.

        `shape`: (height, width) of pictures.
        """
        self.config = config
        self.visible, self.device = np.flatnonzero(visible), torch.device(device)
        self.generator = torch.Generator(self.device).manual_seed(seed)
        self._action_scale = self._tensor(action_scale)
        self._timed: Step | None = None  # an update that changes nothing
        with seeded(seed):
            self.detector = KeypointDetector(
                num_keypoints, len(self.visible), shape, config.detector
            )
            num_inputs = 2 * num_keypoints + len(action_scale)
            self.posterior_net = PosteriorNet(
                num_inputs, self.visible.tolist(), len(visible), config.posterior_net
            )
        self.detector.to(self.device, memory_format=torch.channels_last)  # type: ignore
        self.posterior_net.to(self.device)
        self._scale_px = shape[0] / 8

    def train_detector(
        self, learnt: TrainingPictures, distribution: Distribution, clock: TrainingClock
    ) -> float:
        """Returns the mean loss of the last updates."""
        config = self.config.detector
        space = distribution.space
        unit = space.to_unit(learnt.parameters)[:, self.visible]
        low, high = space.to_unit(distribution.low), space.to_unit(distribution.high)
        width, visible = self._tensor((high - low)[self.visible]), self._tensor(unit)
        keypoints = self._tensor(learnt.keypoints)
        frames, random = torch.from_numpy(learnt.frames).to(self.device), self._random

        def draw_loss() -> torch.Tensor:
            at = torch.randint(len(visible), (config.batch_size,), **random)
            pictures = to_input(frames[at])
            pictures += 2 * config.noise * torch.randn(pictures.shape, **random)
            return self.detector.loss(pictures, keypoints[at], visible[at], width)

        return train_network(
            self.detector, draw_loss, clock, config.learning_rate, graph_with=self.generator
        )

    def time_updates(self, frames: np.ndarray, num: int) -> None:
        """As much work as `num` updates of the detector, without changing it.

        More in the first call, which also captures a graph.
        """
        size = self.config.detector.batch_size
        batch = to_input(np.resize(frames, (size, *frames.shape[1:]))).to(self.device)
        places = batch.new_zeros(size, self.detector.num_keypoints, 2)
        visible = batch.new_zeros(size, len(self.visible))
        width, learnt = batch.new_ones(len(self.visible)), [*self.detector.parameters()]

        def update() -> torch.Tensor:
            loss = self.detector.loss(batch, places, visible, width)
            # No `backward`: a graph would write to gradients that are given up meanwhile.
            torch.autograd.grad(loss, learnt, allow_unused=True)
            return loss.detach()

        if self._timed is None:
            self._timed, num = graphed(update, self.generator), max(num, CALLS_BEFORE_REPLAY)
        losses = [self._timed() for _ in range(num)]
        losses[-1].item()  # waits for a GPU

    def detect(self, frames: np.ndarray) -> Detections:
        """In (..., H, W, 3) frames, flattened to one axis."""
        return detect(self.detector, frames.reshape(-1, *frames.shape[-3:]))

    def detector_errors(
        self, worlds: FilmedWorlds, detections: Detections, distribution: Distribution
    ) -> DetectorErrors:
        """The detector's errors in `worlds`, in whose frames it found `detections`."""
        num_worlds, num_filmed = worlds.frames.shape[:2]
        estimated = detections.visible.reshape(num_worlds, num_filmed, -1).mean(1)
        truth = distribution.to_range_unit(worlds.parameters)[:, self.visible]
        visible = self._to_range_unit(estimated, distribution) - truth
        errors = worlds.keypoint_errors(detections.keypoints)
        return DetectorErrors(worlds.filmed_keypoints(), errors, visible)

    def train_posterior_net(
        self,
        worlds: SimulatedWorlds,
        distribution: Distribution,
        errors: DetectorErrors,
        clock: TrainingClock,
    ) -> float:
        """On sets of episodes of one world; returns the mean loss of the last updates."""
        config = self.config.posterior_net
        self.posterior_net.most_episodes.fill_(worlds.actions.shape[1])
        batches = PosteriorBatches(worlds, errors, self.visible, config, self.generator)
        truth = self._tensor(distribution.to_range_unit(worlds.parameters))

        def draw_loss() -> torch.Tensor:
            at, keypoints, actions, visible = batches.draw(truth)
            curves = self.posterior_net(self._motion(keypoints, actions), visible)
            return posterior_loss(curves, truth[at], config.candidates, self.generator)

        return train_network(
            self.posterior_net,
            draw_loss,
            clock,
            config.learning_rate,
            weight_decay=config.weight_decay,
            largest_gradient=_LARGEST_GRADIENT,
        )

    @torch.no_grad()
    def curves(
        self, episodes: Sequence[Detections], actions: np.ndarray, distribution: Distribution
    ) -> SurvivalMixture:
        """The survival curves (1, N) of one world, in coordinates of the range.

        `episodes`: detections in at least T + 1 frames of each; `actions`: (E, T, A).
        """
        keypoints = np.stack([found.keypoints[: actions.shape[1] + 1] for found in episodes])
        visible = np.mean([found.visible.mean(0) for found in episodes], 0)
        pooled = self._tensor(self._to_range_unit(visible[None], distribution))
        motion = self._motion(self._tensor(keypoints[None]), self._tensor(actions[None]))
        return self.posterior_net(motion, pooled).cpu()

    def tensors(self) -> dict[str, torch.Tensor]:
        """For a checkpoint."""
        parts = {"detector": self.detector, "posterior_net": self.posterior_net}
        tensors = {f"{p}.{k}": v for p, m in parts.items() for k, v in m.state_dict().items()}
        return tensors | {"generator": self.generator.get_state()}

    def load(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """Raises InputError for weights of other networks than this version has."""
        load_weights(self.detector, under("detector.", tensors), "detector")
        load_weights(self.posterior_net, under("posterior_net.", tensors), "posterior_net")
        load_generator(self.generator, tensors["generator"])

    def _motion(self, keypoints: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """(B, E, T + 1, L, 2) pixels and (B, E, T, A) actions, side by side: (B, E, T, S)."""
        middle = self.detector.grid.mean(0)
        places = (keypoints[:, :, :-1] - middle).flatten(-2) / self._scale_px
        return torch.cat([places, actions / self._action_scale], -1)

    def _tensor(self, array: np.ndarray) -> torch.Tensor:
        return torch.tensor(array, dtype=torch.float32, device=self.device)

    @property
    def _random(self) -> dict[str, Any]:
        """Arguments for random numbers on the device."""
        return {"generator": self.generator, "device": self.device}

    def _to_range_unit(self, estimated: np.ndarray, distribution: Distribution) -> np.ndarray:
        """(..., V) from unit coordinates of the detector to coordinates of the range."""
        space = distribution.space
        low = space.to_unit(distribution.low)[self.visible]
        high = space.to_unit(distribution.high)[self.visible]
        return (estimated - low) / (high - low)
