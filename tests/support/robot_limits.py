"""Limits that robots' tests keep to, and actions that try to get beyond them."""

import numpy as np

from simtune.robot.displacements import Displacements
from simtune.robot.limits import Limits

LOW, HIGH = np.array([200.0, -200.1, 100.0]), np.array([500.0, 200.0, 400.3])
LIMITS = Limits(low=LOW, high=HIGH, speed=100.0, tolerance=5.0)
STEP_S = 0.3
START = np.array([300.0, 0.0, 200.0])
ACTIONS = Displacements.of(["-y", "x"], 25.0, [[-1, 1], [-1, 1]], ["x", "y", "z"], START)


def strange_action(rng: np.random.Generator) -> object:
    """What a healthy policy gives, and all that an ill one might."""
    kind = rng.integers(8)
    if kind < 3:
        return rng.uniform(-1, 1, 2)
    if kind == 3:
        return rng.normal(size=2) * 10.0 ** rng.integers(-300, 300)
    if kind == 4:
        return rng.choice([np.nan, np.inf, -np.inf, 0.5, -0.0, 1e308], 2)
    if kind == 5:
        return rng.integers(-(2**62), 2**62, 2)
    if kind == 6:
        return rng.uniform(-1, 1, rng.integers(0, 4, rng.integers(0, 3))).astype(np.float32)
    return [None, "left", [[1.0], [2.0]], (True, False), np.array([1j, 2]), {}][rng.integers(6)]
