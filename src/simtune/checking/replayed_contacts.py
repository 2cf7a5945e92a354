"""Which geoms touch in replays of recordings: a contact that the robot does not have misleads."""

import copy
from collections.abc import Collection, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from simtune.checking.frictions import contacts_of_each, geom_name
from simtune.columns import counted, cut
from simtune.fit import OpenLoopReplay
from simtune.fit.readings.segments import Stretches
from simtune.parameters import ModelWriter
from simtune.parameters.joint_types import FREE, SLIDE
from simtune.simulation.loose_objects import loose_joints

_MOST_TOLD, _MOST_NAMED = 3, 4  # groups of geoms; geoms or episodes in each
_BEGINS_WITHIN_S = 0.05  # what touches so early has begun there
_WORLD_TREE, _MOVED_TREE = -1, -2  # in place of a tree's number: MuJoCo's, a mocap body's or flex's


class Touching(NamedTuple):
    """Two geoms that touch in replays."""

    geoms: tuple[str, str]  # the second one is part of the world, if one is
    episodes: tuple[int, ...]


def touching(
    loop: OpenLoopReplay, whole: Stretches, states: np.ndarray, unit: np.ndarray
) -> list[Touching]:
    """In replays of whole episodes, or their beginnings, from (E, nq + nv) states.

    At (N,) unit coordinates. What touches first comes first. What a robot stands on in all of them
    from the beginning, such as its feet or wheels on a floor, is left out. So are loose objects
    that the robot does not touch: some were put away, and fall there.
    """
    physics, space = loop.physics, loop.physics.parameters
    units = np.repeat(unit[None, : len(space)], len(states), 0)
    played, _ = physics.play(states, units, whole.actions, whole.actuator_states)
    model = copy.copy(physics.simulator.model)
    ModelWriter(space, model).write(model, space.from_unit(units[0]))
    found = dict[tuple[int, int], dict[int, int]]()  # {geoms: {episode: first row}}
    are_rows = np.arange(played.shape[1]) < _rows(whole)[:, None]
    places, each = np.argwhere(are_rows).tolist(), contacts_of_each(model, played[are_rows])
    for (episode, row), contacts in zip(places, each, strict=True):
        for pair in contacts.geoms[contacts.exclude == 0].tolist():
            found.setdefault(_ordered(model, *pair), {}).setdefault(episode, row)
    on_its_own = _untouched(model, found)
    found = {pair: rows for pair, rows in found.items() if not on_its_own.issuperset(pair)}
    in_time = sorted(found.items(), key=lambda item: min(item[1].values()))
    early = _BEGINS_WITHIN_S / physics.simulator.step_s
    in_time = [
        (pair, rows)
        for pair, rows in in_time
        if not (_stands(model, *pair) and len(rows) == len(states) and max(rows.values()) <= early)
    ]
    return [
        Touching((geom_name(model, one), geom_name(model, other)), tuple(episodes))
        for (one, other), episodes in in_time
    ]


def in_words(found: Sequence[Touching], names: Sequence[str]) -> str:
    """A sentence on what touches in the replays of episodes with these names."""
    groups = dict[tuple[str, tuple[int, ...]], list[str]]()
    for (one, other), episodes in found:
        groups.setdefault((other, episodes), []).append(one)
    told = []
    for (other, episodes), ones in groups.items():
        few = cut([names[episode] for episode in episodes], _MOST_NAMED)
        which = f" ({few})" * (len(episodes) < len(names))
        touch = "touches" if len(ones) == 1 else "touch"
        share = f"{len(episodes)} of {counted(len(names), 'episode')}"
        told.append(f"{cut(ones, _MOST_NAMED)} {touch} {other} in {share}{which}")
    return f"{cut(told, _MOST_TOLD, '; ')}: is it so on the robot?"


def _rows(whole: Stretches) -> np.ndarray:
    """(E,) rows until the last reading: shorter episodes are padded."""
    is_read = np.asarray(np.isfinite(whole.values).any(-1))
    return is_read.shape[1] - is_read[:, ::-1].argmax(1)


def _untouched(model: mujoco.MjModel, pairs: Collection[tuple[int, int]]) -> set[int]:
    """The world's geoms, and those of loose objects which nothing else of these pairs moves.

    Something else is a robot, or an object that a robot moves.
    """
    loose = set(model.body_treeid[model.jnt_bodyid[loose_joints(model)]].tolist())
    body = model.geom_bodyid
    is_mocap = model.body_mocapid[model.body_rootid[body]] >= 0
    trees = np.where(is_mocap, _MOVED_TREE, model.body_treeid[body]).tolist()
    trees = [*trees, _MOVED_TREE]  # a flex's last
    alone = loose | {_WORLD_TREE}
    while reached := {
        trees[geom]
        for pair in pairs
        if not alone.issuperset(trees[body] for body in pair)
        for geom in pair
    } & (alone - {_WORLD_TREE}):
        alone -= reached
    return {geom for geom in range(model.ngeom) if trees[geom] in alone}


def _stands(model: mujoco.MjModel, one: int, other: int) -> bool:
    """Whether the first geom is of what nothing but contacts carries, the second of the world."""
    if min(one, other) < 0 or model.body_weldid[model.geom_bodyid[other]]:
        return False
    tree = model.body_treeid[model.geom_bodyid[one]]
    if tree < 0:
        return False
    base = model.jnt_bodyid[model.dof_jntid[model.tree_dofadr[tree]]]
    return bool(np.isin(model.jnt_type[model.jnt_bodyid == base], (FREE, SLIDE)).any())


def _ordered(model: mujoco.MjModel, one: int, other: int) -> tuple[int, int]:
    """Two geoms, with one of the world last."""
    is_world = one >= 0 and not model.body_weldid[model.geom_bodyid[one]]
    return (other, one) if is_world else (one, other)
