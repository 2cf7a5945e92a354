"""Objects whose value of a field cannot be tuned, although they have the field."""

import mujoco
import numpy as np

from simtune.parameters.backlash import driven_through
from simtune.parameters.field import Field
from simtune.parameters.fields import FOLLOWS, HINGE_OR_SLIDE

_CAM = mujoco.mjtCamLight
_SHAPED_BY_ASSETS = (mujoco.mjtGeom.mjGEOM_MESH.value, mujoco.mjtGeom.mjGEOM_HFIELD.value)
_OF_MOVING = ("body_mass", "body_inertia", "body_gravcomp")
_AIMED = (_CAM.mjCAMLIGHT_TARGETBODY.value, _CAM.mjCAMLIGHT_TARGETBODYCOM.value)
# Limits, as MJCF calls them: MuJoCo ignores the numbers of one that is off (`*_limited`)
_LIMITS = {
    **dict.fromkeys(("jnt_range", "tendon_range"), "range"),
    **dict.fromkeys(("jnt_actfrcrange", "tendon_actfrcrange"), "actuatorfrcrange"),
    **{f"actuator_{kind}range": f"{kind}range" for kind in ("ctrl", "force", "act")},
}


def why_not_tunable(field: Field, model: mujoco.MjModel, rows: np.ndarray, name: str) -> str:
    """Reason why this object's value, in `rows` of the field, cannot be tuned; "" if none."""
    if field.name == "geom_size" and model.geom_type[rows].item() in _SHAPED_BY_ASSETS:
        return f"{name} has the size of its mesh or height field: scale that"
    if field.name in _OF_MOVING and model.body_weldid[rows].item() == 0:
        return f"{name} cannot move, so its {field.name[5:]} changes nothing"
    if field.form == "shift" and model.joint(name).type[0] not in HINGE_OR_SLIDE:
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
    if field.name == "cam_quat" and model.cam_mode[rows].item() in _AIMED:
        return f"{name} turns by itself, towards a body, so no angle of it can be tuned"
    if field.is_lag and model.actuator_dyntype[rows].item() not in FOLLOWS:
        return f"{name} has dynamics of its own (dyntype), so it can have no lag"
    return ""
