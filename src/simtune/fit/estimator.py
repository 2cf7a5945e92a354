"""A first guess at the states behind what the detector saw: a small network over time."""

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from simtune.fit.tracks import Tracks
from simtune.networks import seeded
from simtune.progress import Progress
from simtune.simulation.states import StateSpace

_CHANNELS = 96
_DILATIONS = (1, 2, 4)  # with kernels of 5: 14 frames to either side
_CROP, _BATCH, _LEARNING_RATE = 48, 48, 3e-3


class StateEstimator:
    """From tracks to a state at every frame; exact only where keypoints fix the state."""

    def __init__(
        self,
        space: StateSpace,
        num_keypoints: int,
        action_scale: np.ndarray,
        scale_px: float,
        seed: int,
    ):
        self._space, self._scale_px = space, scale_px
        self._action_scale = np.asarray(action_scale)
        self._num_seen = 6 * num_keypoints + len(self._action_scale)
        self._generator = torch.Generator().manual_seed(seed)
        self._seed = seed
        self.spread = np.ones(space.num_tangent)  # of its errors, robustly, one tangent each

    def train(self, tracks: Tracks, states: np.ndarray, progress: Progress) -> float:
        """Teach it (E, T + 1, nq + nv) true states behind `tracks`; the last updates' mean loss.

        The last fifth of the episodes is kept to measure how far its estimates are off.
        """
        num_taught = max(1, len(states) * 4 // 5)
        seen = self._input(tracks)
        features = self._space.features(states)
        flat = features[:num_taught].reshape(-1, features.shape[-1])
        self._mean, self._std = flat.mean(0), flat.std(0) + 1e-6
        goal = torch.tensor((features - self._mean) / self._std, dtype=torch.float32).transpose(
            1, 2
        )
        with seeded(self._seed):
            self._network = _Network(self._num_seen, features.shape[-1])
        optimizer = torch.optim.AdamW(self._network.parameters(), _LEARNING_RATE)
        crop = min(_CROP, seen.shape[-1])
        losses = []
        while progress.fraction() < 1:
            optimizer.param_groups[0]["lr"] = progress.learning_rate(_LEARNING_RATE)
            which = self._random(num_taught, _BATCH)[:, None, None]
            start = self._random(seen.shape[-1] - crop + 1, _BATCH)[:, None, None]
            at = start + torch.arange(crop)
            given = seen[which, torch.arange(seen.shape[1])[:, None], at]
            wanted = goal[which, torch.arange(goal.shape[1])[:, None], at]
            loss = F.smooth_l1_loss(self._network(given), wanted, beta=0.2)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.item())
            progress.step()
        self._measure_spread(tracks.episodes(slice(num_taught, None)), states[num_taught:])
        return float(np.mean(losses[-50:]))

    def __call__(self, tracks: Tracks) -> np.ndarray:
        """(E, T + 1, nq + nv) states."""
        with torch.no_grad():
            estimated = self._network(self._input(tracks)).transpose(1, 2).double().numpy()
        return self._space.from_features(estimated * self._std + self._mean)

    def _measure_spread(self, tracks: Tracks, states: np.ndarray) -> None:
        if not len(states):
            return
        errors = np.abs(self._space.difference(self(tracks), states))
        self.spread = 1.48 * np.median(errors, (0, 1)) + 1e-4

    def _input(self, tracks: Tracks) -> torch.Tensor:
        """(E, S, T + 1): places, how probable, and the action that follows each frame."""
        last = np.zeros_like(tracks.actions[:, :1])
        actions = np.concatenate([tracks.actions, last], 1) / self._action_scale
        places = tracks.places / self._scale_px - 4
        flat = [x.reshape(*actions.shape[:2], -1) for x in (places, tracks.probability, actions)]
        seen = np.concatenate(flat, -1)
        return torch.tensor(seen, dtype=torch.float32).transpose(1, 2)

    def _random(self, high: int, num: int) -> torch.Tensor:
        return torch.randint(high, (num,), generator=self._generator)


class _Network(nn.Module):
    def __init__(self, num_in: int, num_out: int):
        super().__init__()
        c = _CHANNELS
        self.first = nn.Conv1d(num_in, c, 1)
        self.layers = nn.ModuleList(
            [nn.Conv1d(c, c, 5, padding=2 * d, dilation=d) for d in _DILATIONS]
        )
        self.last = nn.Conv1d(c, num_out, 1)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """(B, S, T) to (B, F, T)."""
        x = F.elu(self.first(seen))
        for layer in self.layers:
            x = x + F.elu(layer(x))
        return self.last(x)
