"""What recorded actions of motors may be instead: of the other sign, or of another motor.

A servo's command says where its joint should be; a motor's says only what pushes it, so a mistake
shows in the motion alone.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from simtune.simulation.actions import ActionMapping
from simtune.simulation.servos import actuator_name, motors
from simtune.simulation.simulator import Simulator

_MAX_ALL_PAIRS = 8  # of which any two may be exchanged; of more, neighbours


class OtherActions(NamedTuple):
    """A change of (..., A) actions."""

    says: str
    act: np.ndarray  # (A,) actions to take
    push: np.ndarray  # (A,) factor on them

    def of(self, actions: np.ndarray) -> np.ndarray:
        return actions[..., self.act] * self.push


def other_actions(simulator: Simulator) -> Iterator[OtherActions]:
    """One that may be meant: of a motor that pushes both ways, reversed, or of two, exchanged."""
    mapping, of_motors = simulator.action_mapping, _of_motors(simulator)
    each, same = np.arange(simulator.num_actions), np.ones(simulator.num_actions)
    for action in _two_sided(mapping, of_motors):
        says = f"{mapping.names[action]} seems to push the other way"
        yield OtherActions(says, each, np.where(each == action, -1.0, same))
    for one, other in pairs(of_motors):
        says = f"actions of {mapping.names[one]} and {mapping.names[other]} seem to be exchanged"
        yield OtherActions(says, exchanged(each, one, other), same)


def all_reversed(simulator: Simulator) -> Iterator[OtherActions]:
    """Those of all motors that push both ways, reversed together, if there are several."""
    mapping = simulator.action_mapping
    if len(both := _two_sided(mapping, _of_motors(simulator))) > 1:
        each = np.arange(simulator.num_actions)
        says = f"{' and '.join(mapping.names[i] for i in both)} seem to push the other way"
        yield OtherActions(says, each, np.where(np.isin(each, both), -1.0, 1.0))


def _of_motors(simulator: Simulator) -> list[int]:
    """Actions that motors take."""
    model = simulator.model
    pushes = {actuator_name(model, i) for i in np.flatnonzero(motors(model)).tolist()}
    return [i for i, name in enumerate(simulator.action_mapping.names) if name in pushes]


def _two_sided(mapping: ActionMapping, actions: Sequence[int]) -> list[int]:
    """Those of the actions that push both ways."""
    return [i for i in actions if mapping.range[i][0] < 0 < mapping.range[i][1]]


def pairs(some: Sequence[int]) -> Iterator[tuple[int, int]]:
    """That may be exchanged: any two of a few, neighbours of many."""
    for one, other in combinations(some, 2):
        if len(some) <= _MAX_ALL_PAIRS or some.index(other) == some.index(one) + 1:
            yield one, other


def exchanged(columns: np.ndarray, one: int, other: int) -> np.ndarray:
    """(D,) columns with two of them in each other's place."""
    changed = columns.copy()
    changed[[one, other]] = columns[[other, one]]
    return changed
