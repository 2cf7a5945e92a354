"""Acting on pictures: stacks of the latest ones, and actions in a task's own units."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from simtune.simulation.actions import ActionSpace
from simtune.simulation.any_simulator import Act, AnySimulator
from simtune.simulation.rendering.stray_light import StrayLight

# (n, K, H, W, 3) uint8, the latest frames of n worlds, to (n, A) actions in [−1, 1]
PixelPolicy = Callable[[np.ndarray], np.ndarray]


class LiveCamera(NamedTuple):
    """A camera between drawn pictures and a policy, at every step."""

    image_size: int  # H' of its pictures
    film: Callable[[np.ndarray], np.ndarray]  # (n, H, W, 3) uint8 to (n, H', W', 3), same aspect


class FrameStacker:
    """Films n worlds of (n, N) parameters while they are played, and stacks the latest frames."""

    frames: np.ndarray  # (n, num_steps + 1, H, W, 3) uint8, of the steps drawn so far

    def __init__(
        self,
        simulator: AnySimulator,
        parameters: np.ndarray,
        num_steps: int,
        num_stacked: int,
        camera: LiveCamera | None = None,
        stray: StrayLight | None = None,
    ):
        """`camera`: None: pictures are seen as drawn. `stray`: of the n worlds."""
        height, width = simulator.shape
        if camera:
            height, width = camera.image_size, camera.image_size * width // height
        self._film = camera.film if camera else None
        self.frames = np.empty((len(parameters), num_steps + 1, height, width, 3), np.uint8)
        self._simulator, self._parameters, self._stray = simulator, parameters, stray
        self._offsets = np.arange(1 - num_stacked, 1)

    def draw(self, t: int, states: np.ndarray) -> np.ndarray:
        """Draw the (n, S) states of step t: (n, K, H, W, 3) uint8, the newest last.

        An episode's first frame is repeated for the steps before it.
        """
        drawn = self._simulator.render(states, self._parameters, self._stray)
        self.frames[:, t] = self._film(drawn) if self._film else drawn
        return self.frames[:, np.maximum(t + self._offsets, 0)]


def scale_actions(mapping: ActionSpace, actions: np.ndarray) -> np.ndarray:
    """(n, A) actions in [−1, 1], as policies give them, to a task's own units."""
    low, high = mapping.range.T
    return low + (np.clip(actions, -1, 1) + 1) / 2 * (high - low)


def on_pictures(simulator: AnySimulator, stacker: FrameStacker, policy: PixelPolicy) -> Act:
    """Acts in `simulator` as a policy does on the stacks that `stacker` draws.

    Not for an EnvironmentSimulator, whose states are known only after it was played.
    """
    mapping = simulator.action_mapping
    return lambda t, states: scale_actions(mapping, policy(stacker.draw(t, states)))


def acting_late(act: Act, steps: int) -> Act:
    """The same, with each action carried out `steps` steps later; until then, the first one.

    As `trajectory.delayed`, by which recordings are fitted: 0 may be far away for a servo.
    """
    coming: deque[np.ndarray] = deque()

    def act_late(t: int, states: np.ndarray) -> np.ndarray:
        action = act(t, states)
        if not coming:
            coming.extend([action] * steps)
        coming.append(action)
        return coming.popleft()

    return act_late
