"""What the posterior network is trained on: sets of episodes as a detector would see them."""

from typing import NamedTuple

import numpy as np
import torch

from simtune.search_param_model.posterior_net import PosteriorNetConfig
from simtune.search_param_model.simulated import SimulatedWorlds


class DetectorErrors(NamedTuple):
    """Of R worlds that the detector was not trained on."""

    keypoints: np.ndarray  # (R, F, L, 2) pixels
    visible: np.ndarray  # (R, V) in coordinates of the range


class PosteriorBatches:
    """Sets of episodes of one world each: the truth, plus errors of another world.

    The errors of one world go with each other (its colours mislead the detector everywhere), so a
    set takes all of its errors from one world.
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
        self._errors = torch.from_numpy(errors.keypoints).float()
        self._visible_errors = torch.from_numpy(errors.visible).float()
        self._visible = torch.from_numpy(visible)
        self._config, self._generator = config, generator

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
        start = int(self._random(num_steps - length + 1, 1))
        keypoints = self._keypoints[worlds][:, episodes, start : start + length + 1]
        actions = self._actions[worlds][:, episodes, start : start + length]
        misled_by = self._random(len(self._errors), len(worlds))
        keypoints = keypoints + self._stretches(misled_by, count, length + 1)
        visible = truth[worlds][:, self._visible] + self._visible_errors[misled_by]
        return worlds, keypoints, actions, visible

    def _stretches(self, worlds: torch.Tensor, episodes: int, length: int) -> torch.Tensor:
        """Successive errors of `worlds` for each episode, in turn from a random one on."""
        num_filmed = self._errors.shape[1]
        start = torch.randint(num_filmed, (len(worlds), episodes, 1), generator=self._generator)
        at = (start + torch.arange(length)) % num_filmed
        return self._errors[worlds[:, None, None], at]

    def _random(self, high: int, num: int) -> torch.Tensor:
        return torch.randint(high, (num,), generator=self._generator)
