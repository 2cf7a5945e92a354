"""A student that acts on pixels: it detects where things are, and imitates a teacher.

Learning to act from pixels end to end is slow because seeing has to be learnt from rewards. In
simulation, positions in a picture are known, so the student is first trained on these, like the
SPM's detector (`vision/detector.py`), in some hundred updates. Acting on recent detections, on
where things are and how far they have moved, is then easy to learn. Besides keypoints it learns to
estimate the state's positions: for a camera that moves with a cheetah, only the ground shows the
cheetah's height.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from simtune.agents.agent import AgentSpec
from simtune.agents.pixel_networks import descend
from simtune.cameras.pictures import pictures_at_once
from simtune.networks.cuda_graph import graphed, make_capturable, set_rate
from simtune.networks.layers import Standardizer, mlp, predicting
from simtune.vision.detector import DetectorConfig, KeypointDetector, to_input
from simtune.vision.noisy_cameras import NoisyCameras

# About half a pixel, so that a real camera's offset of what stands still does not look large
_ADDED_STD = 0.02
_POSITIONS_WIDTH = 4.0  # width of the range relative to which errors count, in standard deviations


@dataclass(frozen=True, kw_only=True)
class StudentConfig:
    """Measured on cartpole and ball_in_cup, unless said otherwise."""

    # Beside a cheetah that a camera follows, its height is seen by the ground only. Rounded, an
    # update takes two thirds of the time, and keypoints move by a hundredth of a pixel.
    detector: DetectorConfig = field(
        default_factory=lambda: DetectorConfig(reads_rows=True, uses_bfloat16=True)
    )
    hidden_size: int = 256
    batch_size: int = 256
    learning_rate: float = 1e-3
    warm_up: int = 50  # updates of the detector, which is trained first


class Memory(NamedTuple):
    """Pictures of the last call, and the detections in them."""

    frames: torch.Tensor  # (n, K, H, W, 3)
    detected: torch.Tensor  # (n, K, F)


class Student(nn.Module):
    """(n, K, H, W, 3) uint8 frames to (n, A) actions in [−1, 1]."""

    def __init__(self, spec: AgentSpec, config: StudentConfig, generator: torch.Generator):
        """Random numbers of its learning come from `generator`, on the spec's device."""
        super().__init__()
        self._generator = generator
        self.config, self._image_size = config, spec.image_size
        self._image_noise = spec.image_noise
        self.detector = KeypointDetector(
            spec.num_keypoints,
            spec.num_positions,
            (spec.image_size, spec.image_size),
            config.detector,
        )
        num_features = 2 * spec.num_keypoints + spec.num_positions
        # Recent actions may still be to come, and no picture shows them yet.
        num_seen = spec.num_stacked * num_features + spec.max_delay_steps * spec.num_actions
        self.standardized = Standardizer(num_seen, added_std=_ADDED_STD)
        sizes = (num_seen, config.hidden_size, config.hidden_size, spec.num_actions)
        self.head = mlp(sizes, nn.ReLU)
        self.detector_optimizer = torch.optim.AdamW(
            self.detector.parameters(), config.detector.learning_rate, fused=True
        )
        self.head_optimizer = torch.optim.Adam(
            self.head.parameters(), config.learning_rate, fused=True
        )
        self.to(generator.device)
        self.begin_steps()
        self.num_updates = 0  # of the detector
        self.forget()

    def begin_steps(self) -> None:
        """Make its updates anew, which are graphs on a GPU: after optimisers have been loaded."""
        for optimizer in (self.detector_optimizer, self.head_optimizer):
            make_capturable(optimizer, self._generator.device)
        self._see = graphed(self._learn_to_see, self._generator)
        self._imitate = graphed(self._learn_to_act, self._generator)

    def forward(self, detected: torch.Tensor, latest: torch.Tensor) -> torch.Tensor:
        """(B, K, F) recent detections and (B, L) latest actions to (B, A) actions."""
        return self.head(self.standardized(_seen(detected, latest))).tanh()

    def standardize_by(self, detected: torch.Tensor, latest: torch.Tensor) -> None:
        """Standardise the head's inputs from now on by these, shaped as in `forward`."""
        self.standardized.fit(_seen(detected, latest))

    def act(self, frames: torch.Tensor, latest: torch.Tensor) -> torch.Tensor:
        """Pixels and (n, L) latest actions, L = max_delay_steps · A, to actions.

        If all stacks continue the last ones, only their newest frames are processed.
        """
        memory = self._memory
        if memory and self._continues(frames).all():
            newest = self.detect(frames[:, -1])[:, None]
            detected = torch.cat([memory.detected[:, 1:], newest], 1)
        else:
            detected = self.detect(frames.flatten(0, 1)).unflatten(0, frames.shape[:2])
        self._memory = Memory(frames.clone(), detected)
        with predicting(self):
            return self(detected, latest)

    def forget(self) -> None:
        """Remember no pictures: none continues the last ones."""
        self._memory: Memory | None = None

    def _continues(self, frames: torch.Tensor) -> torch.Tensor:
        """(n,) bool: whether stacks begin as those of the last call ended."""
        memory = self._memory
        if memory is None or memory.frames.shape != frames.shape:
            return torch.zeros(len(frames), dtype=torch.bool, device=frames.device)
        return (memory.frames[:, 1:] == frames[:, :-1]).flatten(1).all(1)

    def detect_recorded(self, frames: torch.Tensor) -> torch.Tensor:
        """`detect` in (n, H, W, 3) simulated frames, as a real camera would film them."""
        noise = self._image_noise
        return self.detect(frames, NoisyCameras.draw(noise, 1, self._generator) if noise else None)

    def detect(self, frames: torch.Tensor, camera: NoisyCameras | None = None) -> torch.Tensor:
        """(n, H, W, 3) uint8 to (n, F): keypoints, of which ±1 is a picture's end, and positions.

        Similar things, left and right, get confused: a keypoint's place is the mean of its two most
        probable ones.
        """
        parts = []
        with predicting(self):
            for part in frames.split(pictures_at_once(frames.device, *frames.shape[1:3])):
                pictures = camera(to_input(part)) if camera else to_input(part)
                heatmaps, positions = self.detector(pictures)
                places, probability, _ = self.detector.candidates(heatmaps)
                share = probability / probability.sum(1, keepdim=True)
                place = (share[..., None] * places).sum(1)
                centred = place / self._image_size * 2 - 1
                parts.append(torch.cat([centred.flatten(1), positions], 1))
        return torch.cat(parts)

    def learn_to_see(
        self,
        frames: torch.Tensor,
        keypoints: torch.Tensor,
        positions: torch.Tensor,
        progress: float,
    ) -> torch.Tensor:
        """One step on (B, H, W, 3) frames with known (B, L, 2) keypoints; the loss.

        `positions`: (B, P) of the state, with a standard deviation of about 1. `progress`, in
        [0, 1], is the share of learning that is over.
        """
        peak = self.config.detector.learning_rate
        set_rate(self.detector_optimizer, peak * self._rate(progress))
        loss = self._see(frames, keypoints, positions)
        self.num_updates += 1
        self.forget()  # its detections are outdated
        return loss

    def _learn_to_see(
        self, frames: torch.Tensor, keypoints: torch.Tensor, positions: torch.Tensor
    ) -> torch.Tensor:
        pictures, generator = to_input(frames), self._generator
        if self._image_noise:
            pictures = NoisyCameras.draw(self._image_noise, len(frames), generator)(pictures)
        noise = torch.randn(pictures.shape, generator=generator, device=pictures.device)
        pictures = pictures + 2 * self.config.detector.noise * noise
        width = torch.full_like(positions[0], _POSITIONS_WIDTH)
        loss = self.detector.loss(pictures, keypoints, positions, width)
        descend(loss, self.detector_optimizer)
        return loss.detach()

    def learn_to_act(
        self, detected: torch.Tensor, latest: torch.Tensor, actions: torch.Tensor, progress: float
    ) -> torch.Tensor:
        """One step towards a teacher's (B, A) actions, given (B, K, F) detections; the loss."""
        set_rate(self.head_optimizer, self.config.learning_rate * self._rate(progress))
        return self._imitate(detected, latest, actions)

    def _learn_to_act(
        self, detected: torch.Tensor, latest: torch.Tensor, actions: torch.Tensor
    ) -> torch.Tensor:
        loss = functional.mse_loss(self(detected, latest), actions)
        descend(loss, self.head_optimizer)
        return loss.detach()

    def _rate(self, progress: float) -> float:
        """Of learning, relative to its peak: it rises at first, then falls."""
        return min(1.0, (self.num_updates + 1) / self.config.warm_up) * max(0.02, 1 - progress)


def _seen(detected: torch.Tensor, latest: torch.Tensor) -> torch.Tensor:
    """(B, K, F) detections and (B, L) latest actions to (B, K · F + L).

    The newest detections and the changes between successive ones. Standardised, these show
    velocities; in detections as such they hardly show, and a head needs far more updates: on a
    cartpole its squared error after 4,000 was 0.10, and so it is 0.04.
    """
    return torch.cat([detected[:, -1], detected.diff(dim=1).flatten(1), latest], 1)
