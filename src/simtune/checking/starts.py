"""Joints that begin elsewhere in simulated worlds than readings do."""

from collections.abc import Sequence

import numpy as np

from simtune.checking.doubt import Doubt, grouped
from simtune.checking.nominal import nominal_starts
from simtune.observation import JointSensor, by_column
from simtune.parameters.joint_types import HINGE
from simtune.simulation import Simulator

_SLACK_SHARE = 0.25  # of what starts spread over: farther outside is far
_MIN_SLACK = 0.05  # of the model's extent, or rad: nearer is no other place
_MEND = "say in [initial_state] where it begins"


def far_starts(
    simulator: Simulator, sensors: Sequence[JointSensor], values: np.ndarray, seed: int
) -> list[str]:
    """On measured joints whose first readings, of (E, T + 1, D), are far from simulated starts.

    Where an encoder's zero may be elsewhere, how far both spread is compared. Whole turns of
    endless hinges do not count.
    """
    model = simulator.model
    positions = simulator.state_space.positions_and_velocities(nominal_starts(simulator, seed))
    found = []
    for sensor, column, read in by_column(sensors, values):
        first, joint = read[:, 0], model.joint(sensor.joints[column])
        read = first[np.isfinite(first)]
        if not sensor.is_position or not len(read):
            continue
        is_hinge = joint.type[0] == HINGE
        simulated = positions[:, sensor.places[column]]
        ends = simulated.min(), simulated.max()
        slack = max(
            _SLACK_SHARE * (ends[1] - ends[0]),
            _MIN_SLACK * (1.0 if is_hinge else model.stat.extent),
        )
        knows_zero = not sensor.finds_offsets
        if np.isfinite(sensor.periods[column]):
            middle = sum(ends) / 2 if knows_zero else _middle(read)
            read = _within_half_a_turn(read, of=float(middle))
        if _is_outside(read, ends, slack, knows_zero=knows_zero):
            mend = _MEND if is_hinge or joint.limited[0] else f"give the joint a range, or {_MEND}"
            says = (
                f"{joint.name} begins at {read.min():.3g} to {read.max():.3g} {sensor.unit} in "
                f"readings, and at {ends[0]:.3g} to {ends[1]:.3g} in simulated worlds: {mend}"
            )
            found.append(Doubt(says, mend, joint.name))
    return grouped(found)


def _within_half_a_turn(angles: np.ndarray, of: float) -> np.ndarray:
    return of + (angles - of + np.pi) % (2 * np.pi) - np.pi


def _middle(angles: np.ndarray) -> float:
    """Of angles in rad, which whole turns do not change."""
    return float(np.angle(np.exp(1j * angles).mean()))


def _is_outside(
    read: np.ndarray, ends: tuple[float, float], slack: float, *, knows_zero: bool
) -> bool:
    if not knows_zero:
        return float(np.ptp(read)) > ends[1] - ends[0] + 2 * slack
    return bool(read.min() < ends[0] - slack or read.max() > ends[1] + slack)
