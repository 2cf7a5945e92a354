"""Windows replayed near a guess: their residuals, and how those change with the guess.

Derivatives are finite differences, for which all changed worlds run at once.
"""

from dataclasses import dataclass

import numpy as np

from simtune.fit.physics import Physics
from simtune.fit.windows import Windows

_STATE_DELTA, _SMALLEST_DELTA = 0.01, 1e-5  # of a state's spread; at least
_UNIT_DELTA = 1e-3


@dataclass(frozen=True)
class LinearizationPoint:
    """At the states in which W windows begin, and at the parameters of all."""

    states: np.ndarray  # (W, nq + nv)
    unit: np.ndarray  # (N,)
    damping: np.ndarray  # (W,) of the states' steps
    variance: float  # of the parameters between windows
    step_scale: float = 1.0  # share of a step in the parameters that is taken


class WindowPlayer:
    """Plays windows in worlds of one simulator."""

    def __init__(self, physics: Physics, spread: np.ndarray, fitted: np.ndarray):
        """`spread`: (2 nv,) usual errors of states; `fitted`: (P,) indices of parameters."""
        self._physics, self._space = physics, physics.space
        self._spread, self._fitted = spread, fitted

    def play(self, windows: Windows, states: np.ndarray, units: np.ndarray):
        """(G, W, nq + nv) initial states, (G, N) parameters to rows and keypoints of all steps."""
        groups, num_windows, size = states.shape
        rows, seen = self._physics.play(
            states.reshape(-1, size),
            np.repeat(units, num_windows, 0),
            np.tile(windows.actions, (groups, 1, 1)),
            np.tile(windows.actuator_state, (groups, 1)),
        )
        shape = (groups, num_windows)
        return rows.reshape(*shape, *rows.shape[1:]), seen.reshape(*shape, *seen.shape[1:])

    def linearise(self, windows: Windows, guess: LinearizationPoint, noise_px: np.ndarray):
        """Residuals (W, K, 2, L, 2) and derivatives (W, 2 nv, M), (W, P, M) at a guess.

        The derivatives are the same for both places of a keypoint: M = K · L · 2.
        """
        num_states, num_fitted = self._space.num_tangent, len(self._fitted)
        delta = np.maximum(_STATE_DELTA * self._spread, _SMALLEST_DELTA)
        tangents = np.zeros((1 + num_states + num_fitted, num_states))
        tangents[1 : 1 + num_states] = np.diag(delta)
        states = self._space.move(guess.states, np.repeat(tangents[:, None], len(guess.states), 1))
        units = np.repeat(guess.unit[None], len(tangents), 0)
        # Away from the bounds
        step = np.where(guess.unit[self._fitted] > 0.5, -_UNIT_DELTA, _UNIT_DELTA)
        units[1 + num_states + np.arange(num_fitted), self._fitted] += step
        _, seen = self.play(windows, states, units)
        change = (seen[1:] - seen[0]) / noise_px[:, None]
        change = change.reshape(len(change), len(guess.states), -1).swapaxes(0, 1)
        by_state = change[:, :num_states] / delta[:, None]
        by_parameter = change[:, num_states:] / step[:, None]
        return residuals(windows, seen[:1], noise_px)[0], by_state, by_parameter


def residuals(windows: Windows, seen: np.ndarray, noise_px: np.ndarray) -> np.ndarray:
    """(G, W, K, 2, L, 2) of (G, W, K, L, 2) keypoints to each place, in units of the detector's noise."""
    return (seen[:, :, :, None] - windows.places) / noise_px[:, None]


def eliminate(
    by_state: np.ndarray, by_parameter: np.ndarray, weight: np.ndarray, spread: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The windows' unknown initial states out of the equations.

    (W, 2 nv, 2 nv) curvature in the states, (W, 2 nv, P) in both, (W, 2 nv, P) how the best
    states follow the parameters, (W, P, P) what is left to know the parameters by.
    """
    hessian = np.einsum("wsm,wm,wtm->wst", by_state, weight, by_state, optimize=True)
    hessian += np.diag(spread**-2)
    cross = np.einsum("wsm,wm,wpm->wsp", by_state, weight, by_parameter, optimize=True)
    # Undamped: a window whose states cannot move would seem to know the parameters well.
    to_parameters = np.linalg.solve(hessian + 1e-6 * diagonal(hessian), cross)
    information = np.einsum("wpm,wm,wqm->wpq", by_parameter, weight, by_parameter)
    return hessian, cross, to_parameters, information - cross.swapaxes(1, 2) @ to_parameters


def diagonal(matrices: np.ndarray) -> np.ndarray:
    """(W, S, S) with all but the diagonals zero."""
    return np.einsum("wss->ws", matrices)[:, None] * np.eye(matrices.shape[1])
