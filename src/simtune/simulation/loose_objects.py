"""Objects that nothing holds: boxes to be pushed, balls to be thrown."""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.parameters.joint_types import FREE, HINGE, SLIDE
from simtune.simulation.driven_joints import driven_joints
from simtune.simulation.states import StateSpace, turned_about_vertical
from simtune.simulation.ties import joint_ties, tied_bodies, with_tied

_FAR_IN_EXTENTS = 2.0  # of the model, from where it began
_PLACE_QUANTILES = 0.02, 0.98  # an object that was flung away tells nothing


def loose_joints(model: mujoco.MjModel) -> np.ndarray:
    """Joints of free bodies in trees of their own, which nothing is tied to or drives."""
    alone = np.bincount(model.body_rootid[model.jnt_bodyid], minlength=model.nbody) == 1
    alone[model.body_rootid[list(tied_bodies(model))]] = False
    free = np.flatnonzero((model.jnt_type == FREE) & alone[model.jnt_bodyid])
    return np.setdiff1d(free, list(driven_joints(model)))


def passive_joints(model: mujoco.MjModel) -> np.ndarray:
    """Joints that no actuator drives, without those of loose objects: a lid, a door.

    See `driven_joints`; one that is tied to a driven joint is driven, too.
    """
    driven = with_tied(model, driven_joints(model))
    return np.setdiff1d(np.arange(model.njnt), [*driven, *loose_joints(model)])


def gliding_joints(model: mujoco.MjModel, measured: Sequence[int] = ()) -> np.ndarray:
    """Joints of objects on two slides or more, such as a block that is pushed about a table.

    Each alone in a kinematic tree that nothing drives, ties, springs or measures. `measured`:
    indices of positions.
    """
    tree, kind = model.body_treeid[model.jnt_bodyid], model.jnt_type
    is_held = ~np.isin(np.arange(model.njnt), passive_joints(model)) | (model.jnt_stiffness != 0)
    is_held |= np.isin(model.jnt_qposadr, measured) | ~np.isin(kind, (SLIDE, HINGE))
    ties = joint_ties(model)
    is_held[[*model.eq_obj1id[ties], *model.eq_obj2id[ties]]] = True
    held = [*tree[is_held], *model.body_treeid[list(tied_bodies(model))]]
    slides = np.bincount(tree[kind == SLIDE], minlength=model.ntree)
    return np.flatnonzero((slides[tree] >= 2) & ~np.isin(tree, held))


def loose_places(model: mujoco.MjModel) -> list[int]:
    """Where each one's three coordinates and its quaternion begin among positions."""
    return model.jnt_qposadr[loose_joints(model)].tolist()


def astray(model: mujoco.MjModel, space: StateSpace, full_states: np.ndarray) -> np.ndarray:
    """(n,) bool for (n, T + 1, S) states: whether an object went farther than the scene is large.

    A box that a strong arm pressed through a table falls for ever.
    """
    states, places = space.positions_and_velocities(full_states), loose_places(model)
    at = np.array(places, int)[:, None] + np.arange(3)
    away = states[:, :, at] - states[:, :1, at]  # (n, T + 1, objects, 3)
    far = np.linalg.norm(away, axis=-1) > _FAR_IN_EXTENTS * model.stat.extent
    return far.any((1, 2))


def scattered(
    space: StateSpace,
    full_states: np.ndarray,
    places: Sequence[int],
    spread: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """(n, S) states with objects moved sideways and turned about the vertical.

    `places`: of the objects, see `loose_places`. Each is put anywhere in the rectangle in which the
    states have it, made `spread` times as wide, and keeps its height.
    """
    states = space.positions_and_velocities(full_states).copy()
    for place in places:
        sideways, turn = slice(place, place + 2), slice(place + 3, place + 7)
        low, high = np.quantile(states[:, sideways], _PLACE_QUANTILES, axis=0)
        half = spread * (high - low) / 2
        states[:, sideways] = (low + high) / 2 + rng.uniform(-half, half, (len(states), 2))
        angle = rng.uniform(-np.pi, np.pi, len(states))
        states[:, turn] = turned_about_vertical(states[:, turn], angle)
    return space.with_positions_and_velocities(full_states, states)
