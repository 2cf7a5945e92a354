"""What earlier actions left behind where windows begin, which depends on the lags of actuators."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.fit.motion.windows import Windows
from simtune.fit.physics import Physics

_LAG_DELTA = 0.01  # in unit coordinates


@dataclass(frozen=True)
class ActuatorReplay:
    """Of episodes, as a function of unknowns in unit coordinates, the N parameters first."""

    physics: Physics
    lags: Sequence[int]  # indices of the fitted lags
    actions: np.ndarray  # (E, T, A)
    states: np.ndarray  # (E, T + 1, nq + nv) guesses at the motion

    def __call__(self, unit: np.ndarray) -> np.ndarray:
        """(E, T + 1, S); see `Physics.replay_actuators`."""
        unit = unit[: len(self.physics.parameters)]
        return self.physics.replay_actuators(self.actions, self.states, unit)

    def renewed(self, windows: Windows, unit: np.ndarray) -> Windows:
        """The windows with actuator states and their derivatives by the fitted lags, if any."""
        if not self.lags:
            return windows
        begun = self(unit)[windows.episode, windows.step]
        by_lag = {}
        for lag in self.lags:
            step = np.zeros_like(unit)
            step[lag] = -_LAG_DELTA if unit[lag] > 0.5 else _LAG_DELTA
            changed = self(unit + step)[windows.episode, windows.step]
            by_lag[lag] = unit[lag], (changed - begun) / step[lag]
        return replace(windows, actuator_states=begun, by_lag=by_lag)
