"""Units of parameters, by what their objects move."""

import mujoco

from simtune.parameters import Parameter
from simtune.parameters.fields import OF_JOINTS
from simtune.parameters.joint_types import SLIDE
from simtune.simulation.servos import pulls_to_a_place, velocity_servos


def usual_unit(model: mujoco.MjModel, parameter: Parameter) -> str:
    """In tables and reports, where the tuning file says none."""
    info = parameter.field_info
    if parameter.is_factor:
        return "×"
    is_slide = moves_slide(model, parameter)
    if info.name == "actuator_gainprm" and parameter.component == 0:
        return _unit_of_gain(model, parameter.objects[0], is_slide=is_slide)
    return info.unit_of_slides if is_slide and info.unit_of_slides else info.unit


def _unit_of_gain(model: mujoco.MjModel, actuator: str, *, is_slide: bool) -> str:
    """Of a servo; of a motor nothing says what its control is."""
    index = model.actuator(actuator).id
    per = "" if pulls_to_a_place(model)[index] else "·s"
    if per and not velocity_servos(model)[index]:
        return "1"
    return f"N{per}/m" if is_slide else f"N·m{per}/rad"


def moves_slide(model: mujoco.MjModel, parameter: Parameter) -> bool:
    """Whether the first object is a slide, or an actuator of one or of a tendon along lengths."""
    prefix = parameter.field_info.prefix
    if prefix in ("jnt", "dof", "qpos0"):
        return _is_slide(model, model.joint(parameter.objects[0]).id)
    if prefix != "actuator":
        return False
    actuator = model.actuator(parameter.objects[0])
    transmission, driven = actuator.trntype[0], actuator.trnid[0]
    if transmission == mujoco.mjtTrn.mjTRN_TENDON.value:
        return _is_length(model, driven)
    return transmission in OF_JOINTS and _is_slide(model, driven)


def _is_slide(model: mujoco.MjModel, joint: int) -> bool:
    return model.jnt_type[joint] == SLIDE


def _is_length(model: mujoco.MjModel, tendon: int) -> bool:
    """Whether a tendon is metres long: not if it sums angles of hinges."""
    first = model.tendon_adr[tendon]
    wraps = range(first, first + model.tendon_num[tendon])
    joints = [w for w in wraps if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT.value]
    return all(_is_slide(model, model.wrap_objid[wrap]) for wrap in joints)
