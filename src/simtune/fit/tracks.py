"""What sight saw of several episodes, and how sure it was."""

from dataclasses import dataclass

import numpy as np

from simtune.search_param_model.sight import Sight, look


@dataclass(frozen=True)
class Tracks:
    """E episodes of T steps with L landmarks, each at one of two places or elsewhere."""

    places: np.ndarray  # (E, T + 1, 2, L, 2) pixels, the more probable one first
    probability: np.ndarray  # (E, T + 1, 2, L)
    actions: np.ndarray  # (E, T, A)

    def episodes(self, which) -> "Tracks":
        return Tracks(self.places[which], self.probability[which], self.actions[which])

    def delayed(self, steps: int) -> "Tracks":
        """The same, had the actions come so many steps later."""
        late = np.zeros_like(self.actions)
        late[:, steps:] = self.actions[:, : self.actions.shape[1] - steps]
        return Tracks(self.places, self.probability, late)


def track(sight: Sight, frames: np.ndarray, actions: np.ndarray) -> Tracks:
    """What sight makes of (E, T + 1, H, W, 3) frames; (E, T, A) actions go with them."""
    seen = look(sight, frames.reshape(-1, *frames.shape[2:]))
    episodes = frames.shape[:2]
    places = seen.places.reshape(*episodes, *seen.places.shape[1:])
    probability = seen.probability.reshape(*episodes, *seen.probability.shape[1:])
    return Tracks(places, probability, actions.astype(float))
