"""Training data of the posterior network: sets of episodes as a detector would see them."""

from typing import NamedTuple

import numpy as np
import torch

from simtune.search_param_model.posterior_net import PosteriorNetConfig
from simtune.search_param_model.simulated import SimulatedWorlds

_NUM_ALIKE_POSES = 8  # one of whose errors is drawn
_POSE_EVERY_STEPS = 2  # within which a pose hardly changes
_ERROR_RUN_STEPS = 4  # for which the detector makes similar errors
# Longer crops are of fewer worlds: an update takes no longer. They are not cut shorter, since the
# network must have seen how much whole episodes tell.
_MAX_TOTAL_STEPS = 400


class DetectorErrors(NamedTuple):
    """In R held-out worlds, F frames of each."""

    truth: np.ndarray  # (R, F, L, 2) pixels, true keypoints
    keypoints: np.ndarray  # (R, F, L, 2) pixels, detected − true
    visible: np.ndarray  # (R, V) in coordinates of the range


class PosteriorBatches:
    """Sets of episodes of one world each: true keypoints plus errors of the detector.

    Errors depend on the pose: where legs cross, left is taken for right, and an unusual pose for a
    usual one. Light robots get into such poses more often, so errors drawn from any pose would
    teach the network that lively motion is measured well. So each pose gets the errors of one of
    the poses most similar to it. Errors of the visible parameters are those of a random world.
    """

    def __init__(
        self,
        worlds: SimulatedWorlds,
        errors: DetectorErrors,
        visible: np.ndarray,
        config: PosteriorNetConfig,
        generator: torch.Generator,
    ):
        """`visible`: (V,) indices of the parameters that a picture shows."""
        device = generator.device
        arrays = worlds.keypoints, worlds.actions, errors.keypoints, errors.visible, errors.truth
        keypoints, actions, off, off_visible, poses = (
            torch.as_tensor(array, dtype=torch.float32, device=device) for array in arrays
        )
        self._keypoints, self._actions = keypoints, actions
        self._errors, self._visible_errors = off.flatten(0, 1), off_visible
        self._visible = torch.as_tensor(visible, device=device)
        self._config, self._generator = config, generator
        self._alike = _most_alike(keypoints, poses.flatten(0, 1))
        # Sizes are drawn on the CPU, so that it need not wait for a GPU.
        seed = int(self._random(2**31, 1))
        self._sizes = torch.Generator().manual_seed(seed)

    def draw(
        self, truth: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """World indices (B,), keypoints (B, E', T' + 1, L, 2), actions, visible (B, V).

        B is the batch size, but less for long crops. `truth`: (W, N) in coordinates of the range.
        """
        num_worlds, num_episodes, num_steps, _ = self._actions.shape
        worlds = self._random(num_worlds, self._config.batch_size)
        device = worlds.device
        count = 1 + self._random_size(num_episodes)
        episodes = torch.randperm(num_episodes, generator=self._generator, device=device)[:count]
        # Few different lengths: memory that convolutions cache for each shape adds up.
        shortest = min(self._config.shortest_crop, num_steps)
        lengths = torch.linspace(shortest, num_steps, self._config.crop_lengths).long()
        length = int(lengths[self._random_size(len(lengths))])
        worlds = worlds[: max(1, len(worlds) * _MAX_TOTAL_STEPS // max(length, _MAX_TOTAL_STEPS))]
        first = self._random_size(num_steps - length + 1)
        steps = torch.arange(first, first + length + 1, device=device)
        which = worlds[:, None, None], episodes[:, None], steps
        keypoints = self._keypoints[which] + self._errors[self._misled(*which)]
        actions = self._actions[worlds[:, None, None], episodes[:, None], steps[:-1]]
        another = self._random(len(self._visible_errors), len(worlds))
        visible = truth[worlds][:, self._visible] + self._visible_errors[another]
        return worlds, keypoints, actions, visible

    def _misled(
        self, worlds: torch.Tensor, episodes: torch.Tensor, steps: torch.Tensor
    ) -> torch.Tensor:
        """(B, E', T' + 1) poses to take errors from: of the same rank for some steps in a row."""
        alike = self._alike[worlds, episodes, steps // _POSE_EVERY_STEPS]  # (B, E', T' + 1, K)
        num_runs = -(-len(steps) // _ERROR_RUN_STEPS)
        runs = self._random(alike.shape[-1], (*alike.shape[:2], num_runs))
        rank = runs.repeat_interleave(_ERROR_RUN_STEPS, -1)[..., : len(steps), None]
        return alike.gather(-1, rank)[..., 0].long()

    def _random(self, high: int, size: int | tuple[int, ...]) -> torch.Tensor:
        shape = (size,) if isinstance(size, int) else size
        drawn_on = self._generator.device
        return torch.randint(high, shape, generator=self._generator, device=drawn_on)

    def _random_size(self, high: int) -> int:
        return int(torch.randint(high, (1,), generator=self._sizes))


def _most_alike(keypoints: torch.Tensor, poses: torch.Tensor) -> torch.Tensor:
    """(W, E, T', K) indices of the nearest of (M, L, 2) poses, for a part of the steps.

    `keypoints`: (W, E, T, L, 2), of which every `_POSE_EVERY_STEPS`-th step is used.
    """
    looked_at, poses = keypoints[:, :, ::_POSE_EVERY_STEPS].flatten(-2), poses.flatten(-2).float()
    count = min(_NUM_ALIKE_POSES, len(poses))
    nearest = [
        torch.cdist(world.flatten(0, 1).float(), poses).topk(count, largest=False).indices.int()
        for world in looked_at
    ]
    return torch.stack(nearest).unflatten(1, looked_at.shape[1:3])
