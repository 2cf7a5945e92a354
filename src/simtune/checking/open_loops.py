"""Closed loops of a robot that its model may lack, as URDF cannot say them."""

import itertools
from collections.abc import Sequence

import mujoco

from simtune.observation import JointSensor, measured_places
from simtune.parameters.joint_types import HINGE
from simtune.simulation.joints import joints_up_from
from simtune.simulation.loose_objects import passive_joints
from simtune.simulation.ties import dofs_of_ties


def loops_left_open(
    model: mujoco.MjModel, sensors: Sequence[JointSensor], unseen: Sequence[str]
) -> list[str]:
    """One sentence if joints of these names may be those of a loop, such as a five-bar's knees.

    They are hinges without actuator, spring or tie, in branches below different measured joints.
    """
    tied = set[int]().union(*dofs_of_ties(model).values())
    passive, places = set(passive_joints(model).tolist()), set(measured_places(sensors))
    carried = dict[str, list[int]]()  # by measured joints, the nearest first
    for name in unseen:
        joint = model.joint(name)
        is_hinge = joint.type[0] == HINGE and not joint.stiffness.any()
        above = joints_up_from(model, int(joint.bodyid[0]))
        measured = [other for other in above if model.jnt_qposadr[other] in places]
        if is_hinge and joint.id in passive and joint.dofadr[0] not in tied and measured:
            carried[name] = measured
    in_branches = {
        name
        for pair in itertools.combinations(carried, 2)
        if not _is_one_above(*(carried[name] for name in pair))
        for name in pair
    }
    if not in_branches:
        return []
    names = ", ".join(name for name in carried if name in in_branches)
    return [
        f"If {names} close a loop on the robot, the model lacks it: write it as a connect in "
        "<equality>, and what measured joints say of them is used (docs/joint-readings.md#linkages)"
    ]


def _is_one_above(some: Sequence[int], others: Sequence[int]) -> bool:
    """Whether one of two branches of measured joints carries the other, or is the same."""
    return some[0] in others or others[0] in some
