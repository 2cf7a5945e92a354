"""First guess at the states behind observations: a small convolutional network over time."""

from collections.abc import Callable

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from simtune.fit.observed import Observed
from simtune.fit.readings.readings import filled
from simtune.networks.layers import seeded
from simtune.networks.training import TrainingClock, train_network
from simtune.normal import MAD_TO_STD
from simtune.simulation import StateSpace

_CHANNELS = 96
_DILATIONS = (1, 2, 4)  # with kernels of 5: 14 frames to either side
_CROP, _BATCH, _LEARNING_RATE = 48, 48, 3e-3
_HUBER_STDS = 0.2  # from which errors count linearly (Huber 1964)
_STATE_QUANTILES, _MAX_STATE_STDS = (0.005, 0.995), 10.0  # of states that are learnt
_TRAINED_SHARE = 0.8  # of the episodes; the others measure the errors


class StateEstimator:
    """Maps observations to a state at every frame; exact only where they determine the state.

    What is missing of them, such as a reading, is filled in on a line, and marked in columns where
    some was missing in training. How much a line tells must be learnt: train it with such gaps.
    """

    def __init__(
        self,
        space: StateSpace,
        action_scale: np.ndarray,
        network: "_Network",
        marked: np.ndarray,
    ):
        """`marked`: (G,) indices of the features of which the network is told what is missing."""
        self._space, self._action_scale = space, np.asarray(action_scale)
        self._network, self._marked = network, marked
        self.prior_std = np.ones(space.num_tangent)  # robust std of its errors, one per tangent

    @classmethod
    def train(
        cls,
        observed: Observed,
        states: np.ndarray,
        space: StateSpace,
        action_scale: np.ndarray,
        seed: int,
        clock: TrainingClock,
    ) -> "StateEstimator":
        """Train an estimator on the (E, T + 1, nq + nv) true states behind `observed`.

        A part of the episodes is held out to measure its errors.
        """
        generator = torch.Generator().manual_seed(seed)
        num_trained = max(1, int(len(states) * _TRAINED_SHARE))
        (marked,) = np.nonzero(np.isnan(observed.evidence.features).any((0, 1)))
        inputs = _inputs(observed, np.asarray(action_scale), marked)
        mean, std, goal = _goals(space.features(states), num_trained)
        with seeded(seed):
            network = _Network(inputs.shape[1], mean, std)
        draw_loss = _loss_of_crops(network, inputs, goal, num_trained, generator)
        train_network(network, draw_loss, clock, _LEARNING_RATE)
        estimator = cls(space, action_scale, network, marked)
        kept = slice(num_trained, None)
        if num_trained < len(states):
            errors = np.abs(space.difference(estimator(observed.episodes(kept)), states[kept]))
            estimator.prior_std = MAD_TO_STD * np.median(errors, (0, 1)) + 1e-4
        return estimator

    def __call__(self, observed: Observed) -> np.ndarray:
        """(E, T + 1, nq + nv) states."""
        with torch.no_grad():
            inputs = _inputs(observed, self._action_scale, self._marked)
            features = self._network.features(inputs)
        return self._space.from_features(features)


def _inputs(observed: Observed, action_scale: np.ndarray, marked: np.ndarray) -> torch.Tensor:
    """(E, F, T + 1): observations, filled in, and the action that follows each frame.

    Then 1 wherever one of the `marked` observations, (G,) indices, is missing, 0 elsewhere.
    """
    last = np.zeros_like(observed.actions[:, :1])
    actions = np.concatenate([observed.actions, last], 1) / action_scale
    features = observed.evidence.features
    is_missing = np.isnan(features[..., marked])
    inputs = np.concatenate([filled(features), actions, is_missing], -1)
    return torch.tensor(inputs, dtype=torch.float32).transpose(1, 2)


def _goals(features: np.ndarray, num_trained: int) -> tuple[np.ndarray, np.ndarray, torch.Tensor]:
    """(F,) mean and (F,) std of (E, T, F) features, those trained on; and (E, F, T) normalised."""
    flat = features[:num_trained].reshape(-1, features.shape[-1])
    # One object that is flung away would widen the scale until all other states look alike.
    flat = flat.clip(*np.quantile(flat, _STATE_QUANTILES, axis=0))
    mean, std = flat.mean(0), flat.std(0) + 1e-6
    goal = ((features - mean) / std).clip(-_MAX_STATE_STDS, _MAX_STATE_STDS)
    return mean, std, torch.tensor(goal, dtype=torch.float32).transpose(1, 2)


def _loss_of_crops(
    network: "_Network",
    inputs: torch.Tensor,
    goal: torch.Tensor,
    num_trained: int,
    generator: torch.Generator,
) -> Callable[[], torch.Tensor]:
    """Draws the loss of random crops of (E, S, T) inputs and (E, F, T) goals."""
    crop = min(_CROP, inputs.shape[-1])

    def draw_loss() -> torch.Tensor:
        which = torch.randint(num_trained, (_BATCH,), generator=generator)[:, None, None]
        last = inputs.shape[-1] - crop
        start = torch.randint(last + 1, (_BATCH,), generator=generator)[:, None, None]
        at = start + torch.arange(crop)
        given = inputs[which, torch.arange(inputs.shape[1])[:, None], at]
        wanted = goal[which, torch.arange(goal.shape[1])[:, None], at]
        return F.smooth_l1_loss(network(given), wanted, beta=_HUBER_STDS)

    return draw_loss


class _Network(nn.Module):
    """(B, S, T) inputs to (B, F, T) features, with mean 0 and standard deviation 1."""

    def __init__(self, num_in: int, mean: np.ndarray, std: np.ndarray):
        super().__init__()
        c = _CHANNELS
        self._mean, self._std = mean, std  # (F,) of the unnormalised features
        self.first = nn.Conv1d(num_in, c, 1)
        self.layers = nn.ModuleList(
            [nn.Conv1d(c, c, 5, padding=2 * d, dilation=d) for d in _DILATIONS]
        )
        self.last = nn.Conv1d(c, len(mean), 1)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        x = F.elu(self.first(inputs))
        for layer in self.layers:
            x = x + F.elu(layer(x))
        return self.last(x)

    def features(self, inputs: torch.Tensor) -> np.ndarray:
        """(B, T, F) unnormalised."""
        return self(inputs).transpose(1, 2).double().numpy() * self._std + self._mean
