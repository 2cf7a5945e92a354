"""Robots on a free base that do not begin in equilibrium, such as above the floor, or in it.

Readings put a robot's joints where they were, and the tuning file its base. If it cannot rest
there, it falls in every replay, and no parameter explains what the joints do then.
"""

import json
from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.columns import counted, cut
from simtune.fit import OpenLoopReplay, Readings
from simtune.fit.readings.readings import filled
from simtune.observation import columns_of, measured_places
from simtune.parameters.fields import OF_JOINTS
from simtune.parameters.joint_types import FREE, SLIDE
from simtune.simulation.joints import joints_up_from
from simtune.simulation.loose_objects import passive_joints
from simtune.simulation.servos import pulls_to_a_place

_HELD_S = 0.3  # in which what nothing carries falls 44 cm
_FAR_M, _FAR_RAD = 5e-3, np.radians(2)  # at rest, models a payload off settle by .5 mm and .1°
# A robot that is walking tilts when it is held; farther than this it is thrown, or falls freely
_FAR_IN_MOTION_M = 0.1
_CALM_S, _CALM_TRAVEL = 0.1, 0.03  # s, and rad or m that joints at rest may move in that time
_ON_SITE, _ON_BODY = mujoco.mjtTrn.mjTRN_SITE.value, mujoco.mjtTrn.mjTRN_BODY.value
_MOST_NAMED = 5  # episodes


def free_bases(loop: OpenLoopReplay) -> list[int]:
    """Bodies that servos of positions stand on, and that nothing holds or wholly measures."""
    model = loop.physics.simulator.model
    passive, measured = set(passive_joints(model).tolist()), measured_places(loop.sensors)
    pushed = _pushed_trees(model)
    found = dict[int, bool]()
    for joint, is_held in _driven_joints(model).items():
        body = model.body_parentid[model.jnt_bodyid[joint]]
        while body and not model.body_jntnum[body]:
            body = model.body_parentid[body]
        above = joints_up_from(model, int(body))
        unmeasured = [j for j in above if model.jnt_qposadr[j] not in measured]
        is_free = np.isin(model.jnt_type[unmeasured], (FREE, SLIDE)).any()
        if is_free and passive.issuperset(above) and model.body_treeid[body] not in pushed:
            found[int(body)] = found.get(int(body), True) and is_held
    return [body for body, are_held in found.items() if are_held]


def _driven_joints(model: mujoco.MjModel) -> dict[int, bool]:
    """{joint: whether an actuator of it pulls it to a place}; others of it may damp it."""
    found = dict[int, bool]()
    pulls = pulls_to_a_place(model)
    for actuator in np.flatnonzero(np.isin(model.actuator_trntype, OF_JOINTS)):
        joint = int(model.actuator_trnid[actuator, 0])
        found[joint] = found.get(joint, False) or bool(pulls[actuator])
    return found


def _pushed_trees(model: mujoco.MjModel) -> set[int]:
    """Kinematic trees with actuators of sites or bodies, such as rotors, which may carry them."""
    kind, on = model.actuator_trntype, model.actuator_trnid[:, 0]
    bodies = [*model.site_bodyid[on[kind == _ON_SITE]], *on[kind == _ON_BODY]]
    return set(model.body_treeid[bodies].tolist()) if bodies else set()


def unsettled(
    loop: OpenLoopReplay, base: int, readings: Readings, unit: np.ndarray, names: Sequence[str]
) -> list[str]:
    """One warning if a base moves while each episode's first commands hold the joints.

    In a world of (N,) unit coordinates; episodes have these names.
    """
    simulator, step_s = loop.physics.simulator, loop.physics.simulator.step_s
    if simulator.action_mapping.is_relative:
        return []
    moved, turned = _held(loop, base, readings, unit)
    first = filled(readings.values[:, : 1 + max(1, round(_CALM_S / step_s))])
    first = first[..., ~loop.measured.of_actions]
    of_speed = [s.is_velocity for s, _ in columns_of(loop.sensors) if not s.is_torque]
    went = np.where(of_speed, step_s * np.cumsum(first, axis=1), first)
    is_calm = np.ptp(went, axis=1).max(-1) < _CALM_TRAVEL
    away = np.linalg.norm(moved, axis=-1).max(1)
    is_far = np.where(is_calm, (away > _FAR_M) | (turned > _FAR_RAD), away > _FAR_IN_MOTION_M)
    if not is_far.any():
        return []
    worst = int(np.where(is_far, away, -1.0).argmax())
    model, their = simulator.model, [names[e] for e in np.flatnonzero(is_far).tolist()]
    joints = [model.joint(joint).name for joint in reversed(joints_up_from(model, base))]
    of, angle = model.body(base).name or joints[0], np.degrees(turned[worst])
    some = f"{cut(their, _MOST_NAMED)} ({len(their)} of {counted(len(names), 'episode')})"
    return [
        f"{of} does not begin at rest, and no sensor measures where it is: with the joints held by "
        f"the first commands of {some} it {_how(moved[worst])} and turns by {angle:.2g}° within "
        f"{_HELD_S:g} s. No parameter explains what is read then. If the robot stands, name "
        "a keyframe in [initial_state] that has settled "
        "(docs/joint-readings.md#robots-that-stand); if it "
        f"hangs or is mounted, say fixed_joints = {json.dumps(joints)} and its fixed_pose"
    ]


def _how(moved: np.ndarray) -> str:
    """In words, how a base moves by (T, 3) metres."""
    far = moved[np.linalg.norm(moved, axis=-1).argmax()]
    if abs(far[2]) < np.linalg.norm(far) / 2:
        return f"slips by {1e3 * np.linalg.norm(far):.0f} mm"
    return f"{'falls' if far[2] < 0 else 'is thrown up'} by {1e3 * abs(far[2]):.0f} mm"


def _held(
    loop: OpenLoopReplay, base: int, readings: Readings, unit: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(E, T + 1, 3) metres, and the (E,) most radians, by which a body moves from rest."""
    physics, model = loop.physics, loop.physics.simulator.model
    steps = max(1, round(_HELD_S / physics.simulator.step_s))
    few = readings.first(steps)
    read = loop.states_of(few, unit)
    states, held = read.states[:, 0].copy(), np.repeat(few.actions[:, :1], steps, 1)
    states[:, model.nq :] = 0.0
    units = np.repeat(unit[None], len(states), 0)
    played, _ = physics.play(states, units, held, read.actuator_states[:, 0])
    positions = physics.states(played)[..., : model.nq]
    places, turns = np.empty((*positions.shape[:2], 3)), np.empty((*positions.shape[:2], 4))
    data = mujoco.MjData(model)
    for row in np.ndindex(*positions.shape[:2]):
        data.qpos[:] = positions[row]
        mujoco.mj_kinematics(model, data)
        places[row], turns[row] = data.xpos[base], data.xquat[base]
    cosine = np.abs((turns * turns[:, :1]).sum(-1)).clip(0, 1)
    return places - places[:, :1], 2 * np.arccos(cosine.min(1))
