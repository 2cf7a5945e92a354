"""The table [initial_state] of a tuning file."""

import mujoco
import numpy as np

from simtune.errors import UnknownName
from simtune.parameters.backlash_joints import driven_through
from simtune.parameters.joint_types import FREE, HINGE, HINGE_OR_SLIDE, SLIDE
from simtune.simulation.ties import dofs_of_ties
from simtune.tasks.tuning_file.object_names import find_keyframe
from simtune.tasks.tuning_file.start import Spread, Start
from simtune.toml_reading import TomlTable

_KINDS = ("recording", "distribution", "keyframe")
# Share of the model's extent: unlimited slides and free joints start within it of their pose
_NEAR = 0.1
_MOST_TURN = 4 * np.pi  # either way: one turn is all, and of degrees it would be little


def read_initial_state(table: TomlTable, model: mujoco.MjModel) -> Start:
    """Read the table. Raises InputError if it is invalid or does not fit the model."""
    table.allow("kind", "keyframe", "joints", "may_touch")
    kind = table.choice("kind", _KINDS, "recording")
    if "joints" in table and kind != "distribution":
        raise table.error(f'joints go with kind = "distribution" only, got "{kind}"', "joints")
    keyframe = _keyframe(table, model, is_needed=kind == "keyframe")
    pose = model.qpos0 if keyframe < 0 else model.key_qpos[keyframe]
    drawn: dict[str, list[Spread]] = {}
    if kind == "recording":
        drawn = _as_wide_as_joints_go(model, pose)
    elif kind == "distribution":
        drawn = _declared(table, model)
    may_touch = table.flag("may_touch", default=False)
    return Start(where=table.where(), keyframe=keyframe, may_touch=may_touch, **drawn)


def _keyframe(table: TomlTable, model: mujoco.MjModel, is_needed: bool) -> int:
    if "keyframe" not in table and not is_needed:
        return -1
    if "keyframe" not in table:
        raise table.error('kind = "keyframe" needs keyframe = NAME, one of the model\'s', "kind")
    with table.at("keyframe"):
        return find_keyframe(model, table.text("keyframe"))


def _as_wide_as_joints_go(model: mujoco.MjModel, pose: np.ndarray) -> dict[str, list[Spread]]:
    """Initial states as wide as the joints' ranges, for recordings whose start a fit must find."""
    near = _NEAR * model.stat.extent
    positions, turns = [], []
    # Drawn independently, these would violate an equality
    tied = {int(model.dof_jntid[dof]) for dofs in dofs_of_ties(model).values() for dof in dofs}
    for joint in range(model.njnt):
        if joint in tied or _is_of_flex(model, joint) or driven_through(model, joint) >= 0:
            continue
        kind, at = model.jnt_type[joint], int(model.jnt_qposadr[joint])
        if kind in HINGE_OR_SLIDE and model.jnt_limited[joint]:
            positions.append(Spread(at, *map(float, model.jnt_range[joint])))
        elif kind in HINGE_OR_SLIDE:
            width = np.pi if kind == HINGE else near
            positions.append(Spread(at, pose[at] - width, pose[at] + width))
        elif kind == FREE:  # the body lies or stands anywhere near; only its height is kept
            positions += [Spread(i, pose[i] - near, pose[i] + near) for i in (at, at + 1)]
            turns.append(Spread(at + 3, -np.pi, np.pi))
    return {"positions": positions, "turns": turns}


def _is_of_flex(model: mujoco.MjModel, joint: int) -> bool:
    """Whether a joint moves a part of a cloth or soft body, whose parts hold each other."""
    parts = (*model.flex_vertbodyid, *model.flex_nodebodyid)
    return model.jnt_type[joint] == SLIDE and model.jnt_bodyid[joint] in parts


def _declared(table: TomlTable, model: mujoco.MjModel) -> dict[str, list[Spread]]:
    joints = table.table("joints")
    known = {model.joint(i).name: i for i in range(model.njnt) if model.joint(i).name}
    positions, turns, velocities = [], [], []
    for name in joints:
        if name not in known:
            raise joints.error(UnknownName("joint", name, "the model", known), name)
        joint, given = known[name], joints.table(name)
        at, velocity_at = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        kind = model.jnt_type[joint]
        if kind == FREE:
            given.allow("position", "turn")
            if "position" in given:
                triple = given.pairs("position", 3)
                positions += [Spread(at + i, *pair) for i, pair in enumerate(triple)]
            if "turn" in given:
                turns.append(Spread(at + 3, *_turn(given)))
        elif kind in HINGE_OR_SLIDE:
            given.allow("position", "velocity")
            if "position" in given:
                positions.append(Spread(at, *_within_limits(given, model, joint)))
            if "velocity" in given:
                velocities.append(Spread(velocity_at, *given.pair("velocity")))
        else:
            raise joints.error(f"{name} is a ball joint, which cannot be drawn: leave it out", name)
    return {"positions": positions, "turns": turns, "velocities": velocities}


def _turn(given: TomlTable) -> tuple[float, float]:
    """About the vertical, of a free joint."""
    low, high = given.pair("turn")
    if max(abs(low), abs(high)) > _MOST_TURN:
        begin, end = np.deg2rad([low, high])
        raise given.error(
            f"turn is in rad, at most two whole turns, got {low:g} to {high:g}; if "
            f"those are degrees, write {begin:.4g} and {end:.4g}",
            "turn",
        )
    return low, high


def _within_limits(given: TomlTable, model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    low, high = given.pair("position")
    least, most = model.jnt_range[joint]
    if model.jnt_limited[joint] and not least - 1e-6 <= low <= high <= most + 1e-6:
        raise given.error(
            f"position must lie in the joint's range, {least:.4g} to {most:.4g} (rad or m), "
            f"got {low:g} to {high:g}",
            "position",
        )
    return low, high
