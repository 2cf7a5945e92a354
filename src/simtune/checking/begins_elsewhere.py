"""Things that begin elsewhere in simulated worlds than on film, so that hardly anything shows them.

A thing is a kinematic tree: a robot, or an object that nothing holds.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from simtune.before_after.moving_parts import part_name
from simtune.checking.extents import OUT_OF_SIGHT_PX, across, bodies_of, corners_px
from simtune.checking.nominal import NUM_STARTS, nominal_starts
from simtune.columns import counted
from simtune.parameters.joint_types import FREE, SLIDE
from simtune.simulation import Simulator
from simtune.simulation.loose_objects import gliding_joints, loose_joints

_HARDLY_SEEN_SHARE = 0.1  # of the starts
_MIN_MOVE_EXTENTS = 0.005  # of the model
_MAX_MOVING_SHARE = 0.5  # of the episodes


def out_of_sight(simulator: Simulator, seed: int) -> dict[str, str]:
    """{parameter: what hides it} of things that are hardly ever in a first picture."""
    model, trees = simulator.model, _trees_of_parameters(simulator)
    if not simulator.views or not trees:
        return {}
    starts, seen = nominal_starts(simulator, seed), dict[int, np.ndarray]()
    for (body, _), pixels in corners_px(simulator, starts, simulator.views).items():
        tree = int(model.body_treeid[body])
        seen[tree] = seen.get(tree, np.zeros(NUM_STARTS, bool)) | (across(pixels) > OUT_OF_SIGHT_PX)
    outside = {
        tree: int((~are).sum()) for tree, are in seen.items() if are.mean() <= _HARDLY_SEEN_SHARE
    }
    return {
        name: f"{_thing(model, tree)} is outside the picture in {outside[tree]} of {NUM_STARTS} "
        "simulated starts"
        for name, tree in trees.items()
        if tree in outside
    }


def elsewhere_warnings(
    simulator: Simulator,
    states: np.ndarray,
    hidden: Mapping[str, str],
    parameters: Mapping[str, Mapping[str, Any]],
    seed: int,
    *,
    are_recorded: bool,
) -> list[str]:
    """On parameters that do not show, but might if things began as on film.

    In nominal (E, T + 1, S) states. `hidden`: as `out_of_sight` says; `parameters`: conclusions on
    each; `are_recorded`: whether the states are of recorded actions.
    """
    unshown = [name for name, said in parameters.items() if said["verdict"] == "does not show"]
    by_thing = dict[str, list[str]]()
    for name in unshown:
        if name in hidden:
            by_thing.setdefault(hidden[name], []).append(name)
    found = [
        f"{says}, so hardly anything tells of {', '.join(names)}: does [initial_state] say where "
        "it begins, and is the camera's pose right?"
        for says, names in by_thing.items()
    ]
    others = [name for name in unshown if name not in hidden]
    is_filmed = are_recorded and bool(simulator.views)
    return found + (_seldom_moved(simulator, states, others, seed) if is_filmed else [])


def _seldom_moved(
    simulator: Simulator, states: np.ndarray, names: Sequence[str], seed: int
) -> list[str]:
    """On loose objects of these parameters that the recorded actions seldom move.

    Simulated worlds begin with them anywhere, the film perhaps where the robot meets them.
    """
    model, trees = simulator.model, _trees_of_parameters(simulator)
    positions = simulator.state_space.positions_and_velocities(states)
    starts, found = None, list[str]()
    for tree in sorted(_loose_trees(model) if len(states) else ()):
        own = [n for n in names if trees.get(n) == tree and not simulator.space[n].is_appearance]
        places = positions[..., _places(model, tree)]
        moves = (
            np.linalg.norm(places - places[:, :1], axis=-1).max(1)
            > _MIN_MOVE_EXTENTS * model.stat.extent
        )
        if not own or moves.mean() > _MAX_MOVING_SHARE:
            continue
        starts = nominal_starts(simulator, seed) if starts is None else starts
        drawn = simulator.state_space.positions_and_velocities(starts)[:, _places(model, tree)]
        if np.ptp(drawn, axis=0).any():
            found.append(
                f"{', '.join(own)}: the recorded actions move {_thing(model, tree)} in "
                f"{int(moves.sum())} of {counted(len(states), 'simulated episode')}, which begin "
                "with it somewhere else than the film; if they move it there, more shows than is "
                "said here: give its start in [initial_state] more narrowly"
            )
    return found


def _trees_of_parameters(simulator: Simulator) -> dict[str, int]:
    """{parameter: the one thing that it is of}."""
    found = dict[str, int]()
    for parameter in simulator.space.parameters:
        trees = {int(simulator.model.body_treeid[b]) for b in bodies_of(simulator.model, parameter)}
        if len(trees) == 1 and (tree := trees.pop()) >= 0:
            found[parameter.name] = tree
    return found


def _thing(model: mujoco.MjModel, tree: int) -> str:
    """What a tree is called: its first body."""
    return part_name(model, int(np.flatnonzero(model.body_treeid == tree)[0]))


def _loose_trees(model: mujoco.MjModel) -> set[int]:
    joints = [*loose_joints(model), *gliding_joints(model)]
    return set(model.body_treeid[model.jnt_bodyid[joints]].tolist())


def _places(model: mujoco.MjModel, tree: int) -> list[int]:
    """Among positions, the coordinates in metres of a loose object."""
    places = list[int]()
    for joint in np.flatnonzero(model.body_treeid[model.jnt_bodyid] == tree):
        at, kind = int(model.jnt_qposadr[joint]), model.jnt_type[joint]
        if kind == FREE:
            places += range(at, at + 3)
        elif kind == SLIDE:
            places.append(at)
    return places
