"""Short stretches of tracks, and how well a simulated motion explains them.

What the detector saw is a mixture: near the truth with the probability that the detector itself gives to either
place, else anywhere.
"""

from dataclasses import dataclass, replace

import numpy as np

from simtune.fit.tracks import Tracks

_ELSEWHERE = 0.003  # density of a keypoint that is not where the detector is, in units of its noise
_WIDE, _WIDE_SHARE = 4.0, 0.05  # the noise has wider tails than a normal distribution


@dataclass(frozen=True)
class Windows:
    places: np.ndarray  # (W, K, 2, L, 2)
    probability: np.ndarray  # (W, K, 2, L)
    actions: np.ndarray  # (W, K - 1, A)
    states: np.ndarray  # (W, nq + nv) first guess at the initial ones
    actuator_state: np.ndarray  # (W, S) what earlier actions left behind, of `Physics.after`
    episode: np.ndarray  # (W,)
    step: np.ndarray  # (W,)

    def first(self, steps: int) -> "Windows":
        """Only the windows' first so many steps."""
        cut = {"places": self.places, "probability": self.probability}
        cut = {name: values[:, : steps + 1] for name, values in cut.items()}
        return replace(self, **cut, actions=self.actions[:, :steps])

    def cost(self, residual: np.ndarray) -> np.ndarray:
        """(G, W) −log likelihoods of (G, W, K, 2, L, 2) residuals in units of the detector's noise."""
        return -log_likelihood(residual, self.probability)

    def weight(self, residual: np.ndarray) -> np.ndarray:
        """(W, M) how much each coordinate counts: the mixture as if it were normal just here."""
        near, wide, elsewhere = _terms(residual, self.probability)
        total = (near + wide).sum(-2) + elsewhere
        weight = (near + wide / _WIDE**2).max(-2) / total  # (W, K, L)
        return np.repeat(weight[..., None], 2, -1).reshape(len(weight), -1)

    def nearest(self, residual: np.ndarray) -> np.ndarray:
        """(W, K, L, 2) residuals to the place that explains best."""
        near, wide, _ = _terms(residual, self.probability)
        best = (near + wide).argmax(-2)[..., None, :, None]
        return np.take_along_axis(residual, best, -3)[..., 0, :, :]


def log_likelihood(residual: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """(...) of K frames with (..., K, 2, L, 2) residuals in units of the detector's noise.

    `probability`, (..., K, 2, L), that the keypoint is at either place.
    """
    near, wide, elsewhere = _terms(residual, probability)
    return np.log((near + wide).sum(-2) + elsewhere).sum((-1, -2))


def _terms(residual: np.ndarray, probability: np.ndarray):
    """(..., K, 2, L) near and wide, (..., K, L) elsewhere: densities that add up."""
    square = np.minimum(np.square(residual).sum(-1), 1e3)
    near = probability * np.exp(-0.5 * square)
    wide = probability * _WIDE_SHARE * np.exp(-0.5 * square / _WIDE**2)
    return near, wide, (1 - probability.sum(-2)) * _ELSEWHERE + 1e-12


def cut(
    tracks: Tracks, states: np.ndarray, actuator_state: np.ndarray, steps: int, at_most: int
) -> Windows:
    """Windows of so many steps that do not overlap; `at_most` of them, evenly spread.

    (E, T + 1, nq + nv) guesses at states, (E, T + 1, S) what actions left behind.
    """
    num_episodes, num_steps, _ = tracks.actions.shape
    length = min(steps, num_steps)
    starts = np.arange(0, num_steps - length + 1, length)
    episode, step = np.repeat(np.arange(num_episodes), len(starts)), np.tile(starts, num_episodes)
    if len(step) > at_most:
        kept = np.linspace(0, len(step) - 1, at_most).round().astype(int)
        episode, step = episode[kept], step[kept]
    frames = step[:, None] + np.arange(length + 1)
    at = (episode[:, None], frames)
    probability = tracks.probability[at]
    actions = tracks.actions[episode[:, None], frames[:, :-1]]
    begin = (episode, step)
    return Windows(
        tracks.places[at], probability, actions, states[begin], actuator_state[begin], episode, step
    )
