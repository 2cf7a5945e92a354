"""What it takes to act on pictures: to see them as they come, and to move the robot."""

from collections.abc import Callable

import numpy as np

from simtune.simulation.actions import ActionSpace
from simtune.simulation.played import Act
from simtune.simulation.simulator import Simulator

# (n, K, H, W, 3) uint8, the latest frames of n worlds, to (n, A) actions in [−1, 1]
PixelPolicy = Callable[[np.ndarray], np.ndarray]


class Projector:
    """Films n worlds while they are acted in, and shows the latest frames as a stack."""

    def __init__(
        self, simulator: Simulator, parameters: np.ndarray, num_steps: int, num_stacked: int
    ):
        size = simulator.image_size
        self.frames = np.empty((len(parameters), num_steps + 1, size, size, 3), np.uint8)
        self._simulator, self._parameters = simulator, parameters
        self._offsets = np.arange(1 - num_stacked, 1)

    def show(self, t: int, states: np.ndarray) -> np.ndarray:
        """Draw the (n, S) states of step t: (n, K, H, W, 3), where need be the first repeated."""
        self.frames[:, t] = self._simulator.render(states, self._parameters)
        return self.frames[:, np.maximum(t + self._offsets, 0)]


def scale_actions(mapping: ActionSpace, actions: np.ndarray) -> np.ndarray:
    """(n, A) actions in [−1, 1], as policies give them, to a task's own units."""
    low, high = mapping.range.T
    return low + (np.clip(actions, -1, 1) + 1) / 2 * (high - low)


def on_pictures(simulator: Simulator, eye: Projector, policy: PixelPolicy) -> Act:
    """Acts in `simulator` by what a policy makes of the pictures that `eye` shows it."""
    return lambda t, states: scale_actions(simulator.action_mapping, policy(eye.show(t, states)))
