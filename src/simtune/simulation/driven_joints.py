"""Which joints a model's actuators drive."""

import mujoco

from simtune.parameters.fields import OF_JOINTS
from simtune.simulation.joints import joints_up_from
from simtune.simulation.ties import bodies_of_tendon, joints_of_tendon

_TRN = mujoco.mjtTrn
_TENDON = _TRN.mjTRN_TENDON.value
_BY_SITES = _TRN.mjTRN_SITE.value, _TRN.mjTRN_SLIDERCRANK.value
_ORIENTATION = _TRN.mjTRN_SO3.value  # of a ball joint, or of one site in another's frame


def driven_joints(model: mujoco.MjModel) -> set[int]:
    """Joints on which an actuator acts: itself, by a tendon, or by a force at a site.

    A force at a site drives all joints that move it, as thrusters do a free body; one between two
    sites, or along a tendon, those that move one against another. Adhesion drives nothing: it holds
    what is touched.
    """
    driven = set[int]()
    for kind, (first, second) in zip(model.actuator_trntype, model.actuator_trnid, strict=True):
        if kind in OF_JOINTS or (kind == _ORIENTATION and second < 0):
            driven.add(int(first))
        elif kind == _TENDON:
            driven.update(joints_of_tendon(model, first))
            driven |= _joints_between(model, bodies_of_tendon(model, first))
        elif kind in (*_BY_SITES, _ORIENTATION):
            ends = [int(model.site_bodyid[site]) if site >= 0 else 0 for site in (first, second)]
            driven |= _joints_between(model, ends)
    return driven


def _joints_between(model: mujoco.MjModel, bodies: list[int]) -> set[int]:
    """Joints that move some of the bodies, but not all alike."""
    if not bodies:
        return set()
    moved_by = [set(joints_up_from(model, body)) for body in bodies]
    return set.union(*moved_by) - set.intersection(*moved_by)
