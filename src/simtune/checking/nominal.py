"""What the simulator does by itself, at its nominal parameters: where it begins, and goes."""

import numpy as np

from simtune.random_streams import Purpose, stream
from simtune.simulation import Simulator

NUM_STARTS = 64  # drawn


def nominal_starts(simulator: Simulator, seed: int) -> np.ndarray:
    """(NUM_STARTS, S) first states of nominal worlds."""
    worlds = np.tile(simulator.space.nominal, (NUM_STARTS, 1))
    return simulator.begin(worlds, stream(seed, Purpose.STARTS)).states[:, 0]


def nominal_states(simulator: Simulator, actions: np.ndarray, seed: int) -> np.ndarray:
    """(E, T + 1, S) states of the episodes of (E, T, A) actions that do not diverge."""
    worlds = np.tile(simulator.space.nominal, (len(actions), 1))
    return simulator.roll_out(worlds, actions, stream(seed, Purpose.NOMINAL_STATES)).states
