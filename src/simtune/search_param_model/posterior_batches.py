"""What the posterior network is trained on: sets of episodes as a detector would see them."""

from typing import NamedTuple

import numpy as np
import torch

from simtune.search_param_model.posterior_net import PosteriorNetConfig
from simtune.search_param_model.simulated import SimulatedWorlds

_ALIKE = 8  # poses whose errors may stand for each other
_GLANCE = 2  # steps, within which a pose hardly changes
_TOGETHER = 4  # steps, for which the detector is misled in the same way


class DetectorErrors(NamedTuple):
    """Of R worlds that the detector was not trained on, F frames of each."""

    truth: np.ndarray  # (R, F, L, 2) pixels, where keypoints were
    keypoints: np.ndarray  # (R, F, L, 2) pixels, how far from there they were detected
    visible: np.ndarray  # (R, V) in coordinates of the range


class PosteriorBatches:
    """Sets of episodes of one world each: the truth, plus errors that the detector makes there.

    Which errors it makes depends on the pose: it takes a left leg for the right one where they
    cross, and what it has hardly seen for something usual. Light robots get into such poses more
    often, so errors of any pose would teach the network that what looks lively is measured well.
    So each pose takes the errors of one of those that resemble it most. What colours it takes a
    world to have is off as in another world.
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
        self._keypoints = torch.from_numpy(worlds.keypoints)
        self._actions = torch.from_numpy(worlds.actions).float()
        self._errors = torch.from_numpy(errors.keypoints).float().flatten(0, 1)
        self._visible_errors = torch.from_numpy(errors.visible).float()
        self._visible = torch.from_numpy(visible)
        self._config, self._generator = config, generator
        self._alike = _most_alike(self._keypoints, torch.from_numpy(errors.truth).flatten(0, 1))

    def draw(
        self, truth: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """World indices (B,), keypoints (B, E', T' + 1, L, 2), actions, visible (B, V).

        `truth`: (W, N) in coordinates of the range.
        """
        num_worlds, num_episodes, num_steps, _ = self._actions.shape
        worlds = self._random(num_worlds, self._config.batch_size)
        count = 1 + int(self._random(num_episodes, 1))
        episodes = torch.randperm(num_episodes, generator=self._generator)[:count]
        # Few different lengths: what convolutions keep of each shape adds up in memory.
        shortest = min(self._config.shortest_crop, num_steps)
        lengths = torch.linspace(shortest, num_steps, self._config.crop_lengths).long()
        length = int(lengths[self._random(len(lengths), 1)])
        steps = int(self._random(num_steps - length + 1, 1)) + torch.arange(length + 1)
        which = worlds[:, None, None], episodes[:, None], steps
        keypoints = self._keypoints[which] + self._errors[self._misled(*which)]
        actions = self._actions[worlds[:, None, None], episodes[:, None], steps[:-1]]
        another = self._random(len(self._visible_errors), len(worlds))
        visible = truth[worlds][:, self._visible] + self._visible_errors[another]
        return worlds, keypoints, actions, visible

    def _misled(
        self, worlds: torch.Tensor, episodes: torch.Tensor, steps: torch.Tensor
    ) -> torch.Tensor:
        """(B, E', T' + 1) whose errors each pose takes: of one as much alike for some steps."""
        alike = self._alike[worlds, episodes, steps // _GLANCE]  # (B, E', T' + 1, K)
        num_runs = -(-len(steps) // _TOGETHER)
        runs = self._random(alike.shape[-1], (*alike.shape[:2], num_runs))
        rank = runs.repeat_interleave(_TOGETHER, -1)[..., : len(steps), None]
        return alike.gather(-1, rank)[..., 0].long()

    def _random(self, high: int, size: int | tuple[int, ...]) -> torch.Tensor:
        shape = (size,) if isinstance(size, int) else size
        return torch.randint(high, shape, generator=self._generator)


def _most_alike(keypoints: torch.Tensor, poses: torch.Tensor) -> torch.Tensor:
    """(W, E, T', K) which of (M, L, 2) poses are nearest to those of now and then.

    `keypoints`: (W, E, T, L, 2), of which every `_GLANCE`-th step is looked at.
    """
    looked_at, poses = keypoints[:, :, ::_GLANCE].flatten(-2), poses.flatten(-2).float()
    count = min(_ALIKE, len(poses))
    nearest = [
        torch.cdist(its.flatten(0, 1).float(), poses).topk(count, largest=False).indices.int()
        for its in looked_at
    ]
    return torch.stack(nearest).unflatten(1, looked_at.shape[1:3])
