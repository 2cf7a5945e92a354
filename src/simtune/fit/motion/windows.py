"""Windows: short stretches of observations, each with its own initial state."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from simtune.fit.observed import Observed
from simtune.observation import AllEvidence, JointReadings

_MAX_UNUSED_SHARE = 0.1  # of an episode, by windows


@dataclass(frozen=True)
class Windows:
    """W windows of K frames, from E episodes."""

    evidence: AllEvidence  # with leading axes (W, K)
    actions: np.ndarray  # (W, K - 1, A)
    states: np.ndarray  # (W, nq + nv) first guesses at initial states
    actuator_states: np.ndarray  # (W, S) of `Physics.replay_actuators`: what earlier actions left
    episode: np.ndarray  # (W,)
    step: np.ndarray  # (W,) first step of each
    # For actuators with a lag: derivatives of `actuator_states` by unit coordinates. Maps a
    # parameter's index to (its coordinate, (W, S) slopes)
    by_lag: Mapping[int, tuple[float, np.ndarray]] = field(default_factory=dict)

    def left_behind(self, units: np.ndarray) -> np.ndarray:
        """(G, W, S) approximate effects of earlier actions in worlds of (G, N) parameters."""
        states = np.repeat(self.actuator_states[None], len(units), 0)
        for index, (unit, slopes) in self.by_lag.items():
            states += (units[:, index] - unit)[:, None, None] * slopes
        return states

    def of(self, chosen: np.ndarray) -> "Windows":
        """Only some windows: their indices."""
        return Windows(
            self.evidence.at((chosen,)),
            self.actions[chosen],
            self.states[chosen],
            self.actuator_states[chosen],
            self.episode[chosen],
            self.step[chosen],
            {index: (unit, slopes[chosen]) for index, (unit, slopes) in self.by_lag.items()},
        )

    def first(self, steps: int) -> "Windows":
        """Only the first `steps` steps of each window."""
        evidence = self.evidence.at((slice(None), slice(steps + 1)))
        return replace(self, evidence=evidence, actions=self.actions[:, :steps])


def even_length(num_steps: int, steps: int) -> int:
    """Length near `steps`, at most `num_steps`, of windows that share an episode evenly.

    Windows of another length would leave out what follows the last one, up to nearly half of a
    short episode.
    """
    fewer = num_steps // steps
    lengths = [num_steps // number for number in (fewer, fewer + 1)]
    return min(lengths, key=lambda length: abs(np.log(length / steps)))


def not_longer(num_steps: int, steps: int) -> int:
    """`steps`, or less if windows of `steps` would leave out much of an episode of `num_steps`."""
    if num_steps % steps <= _MAX_UNUSED_SHARE * num_steps or num_steps < steps:
        return min(steps, num_steps)
    return num_steps // (num_steps // steps + 1)


def cut(
    observed: Observed,
    states: np.ndarray,
    actuator_states: np.ndarray,
    steps: int,
    at_most: int,
) -> Windows:
    """Non-overlapping windows of `steps` steps; at most `at_most`, spread evenly.

    `states`: (E, T + 1, nq + nv) guesses; `actuator_states`: (E, T + 1, S), see `Windows`.
    """
    num_episodes, num_steps, _ = observed.actions.shape
    length = min(steps, num_steps)
    begins = np.arange(0, num_steps + 1 - length, length)
    episode, step = np.repeat(np.arange(num_episodes), len(begins)), np.tile(begins, num_episodes)
    if len(step) > at_most:
        kept = np.linspace(0, len(step) - 1, at_most).round().astype(int)
        episode, step = episode[kept], step[kept]
    frames = step[:, None] + np.arange(length + 1)
    evidence = observed.evidence.at((episode[:, None], frames))
    return Windows(
        evidence.with_each(JointReadings, JointReadings.of_windows),
        observed.actions[episode[:, None], frames[:, :-1]],
        states[episode, step],
        actuator_states[episode, step],
        episode,
        step,
    )
