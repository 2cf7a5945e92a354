"""Objects whose value of a field cannot be tuned, although they have the field."""

from collections.abc import Callable

import mujoco
import numpy as np

from simtune.parameters.backlash_joints import driven_through
from simtune.parameters.field import Field
from simtune.parameters.fields import FOLLOWS
from simtune.parameters.joint_types import FREE, HINGE_OR_SLIDE

_CAM = mujoco.mjtCamLight
_SHAPED_BY_ASSETS = (mujoco.mjtGeom.mjGEOM_MESH.value, mujoco.mjtGeom.mjGEOM_HFIELD.value)
_AIMED_MODES = (_CAM.mjCAMLIGHT_TARGETBODY.value, _CAM.mjCAMLIGHT_TARGETBODYCOM.value)
_PLACE_FIELDS = ("body_pos", "body_quat")
_MOVING_BODY_FIELDS = ("body_mass", "body_inertia", "body_gravcomp")
_ZERO_FIELDS = ("qpos0", "qpos_spring")
# Limits, as MJCF calls them: MuJoCo ignores the numbers of one that is off (`*_limited`)
_LIMITS = {
    **dict.fromkeys(("jnt_range", "tendon_range"), "range"),
    **dict.fromkeys(("jnt_actfrcrange", "tendon_actfrcrange"), "actuatorfrcrange"),
    **{f"actuator_{kind}range": f"{kind}range" for kind in ("ctrl", "force", "act")},
}


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    return model.body_jntnum[body] > 0 and model.jnt_type[model.body_jntadr[body]] == FREE


# (fields, whether they have no effect on the object in a row, why)
_WITHOUT_EFFECT: tuple[tuple[tuple[str, ...], Callable[[mujoco.MjModel, int], bool], str], ...] = (
    (
        ("geom_size",),
        lambda model, geom: model.geom_type[geom] in _SHAPED_BY_ASSETS,
        "has the size of its mesh or height field: scale that",
    ),
    (
        ("geom_fluid",),
        lambda model, geom: not model.geom_fluid[geom, 0],
        'has no drag of its own: give it fluidshape="ellipsoid" in the model',
    ),
    (
        (*_PLACE_FIELDS, "body_ipos", "body_iquat"),
        lambda _, body: body == 0,
        "is what everything else is placed in: move that instead",
    ),
    (
        _PLACE_FIELDS,
        _is_free,
        "is free, so it lies where its start says, not where its body does: see [initial_state]",
    ),
    (
        _PLACE_FIELDS,
        lambda model, body: model.body_mocapid[body] >= 0,
        "is a mocap body, which a state places, not the model: move what is inside it instead",
    ),
    (
        ("jnt_axis",),
        lambda model, joint: model.jnt_type[joint] not in HINGE_OR_SLIDE,
        "is neither a hinge nor a slide, so it has no axis",
    ),
    (
        ("jnt_pos",),
        lambda model, joint: model.jnt_type[joint] == FREE,
        "is a free joint, which is always at its body's origin",
    ),
    (
        ("cam_quat",),
        lambda model, camera: model.cam_mode[camera] in _AIMED_MODES,
        "turns by itself, towards a body, so no angle of it can be tuned",
    ),
    (
        ("tendon_rgba", "tendon_width"),
        lambda model, tendon: (
            model.wrap_type[model.tendon_adr[tendon]] == mujoco.mjtWrap.mjWRAP_JOINT
        ),
        "is over joints alone (<fixed>), so it is not drawn",
    ),
    (
        ("actuator_cranklength",),
        lambda model, actuator: (
            model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_SLIDERCRANK
        ),
        "drives no slider-crank, so it has no crank",
    ),
)


def why_not_tunable(field: Field, model: mujoco.MjModel, rows: np.ndarray, name: str) -> str:
    """Reason why this object's value, in `rows` of the field, cannot be tuned; "" if none."""
    for fields, is_without, why in _WITHOUT_EFFECT:
        if field.name in fields and is_without(model, int(rows[0])):
            return f"{name} {why}"
    if field.name in _MOVING_BODY_FIELDS and model.body_weldid[rows].item() == 0:
        return f"{name} cannot move, so its {field.name[5:]} changes nothing"
    if field.name in _ZERO_FIELDS and model.joint(name).type[0] not in HINGE_OR_SLIDE:
        return f"{name} is neither a hinge nor a slide, so it has no one zero"
    if field.form == "negative" and model.actuator_biasprm[rows, 1].item() >= 0:
        return f"{name} is no servo of positions (<position>), so it has no damping of its own"
    if field.form == "play" and driven_through(model, int(rows[0])) < 0:
        return (
            f"{name} is no play between a motor and what it moves: declare [[backlash]] with "
            f'joint = "{name}", and its play is "{name}_backlash"'
        )
    limit = _LIMITS.get(field.name) if field.form == "itself" else None
    if limit and not getattr(model, field.name.replace("range", "limited"))[rows].item():
        return f'{name} has no limit: give it a range in the model ({limit}="...")'
    if field.is_lag and model.actuator_dyntype[rows].item() not in FOLLOWS:
        return (
            f"{name} has dynamics of its own (dyntype), so it can have no lag; tune its constants: "
            'field = "actuator_dynprm" with a component, 0 and 1 for a muscle\'s activation and '
            "deactivation"
        )
    return ""
