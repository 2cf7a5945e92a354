"""Makes values explicit that the compiler infers from shapes, masses and the default pose, so that
other ones do not change them.
"""

import mujoco
import numpy as np


def write_down_inferred(spec: mujoco.MjSpec) -> None:
    """Store in a spec what follows from nominal shapes, masses and ranges.

    These are masses and inertias, springs of joints and tendons, dampers of joints, and of
    actuators the damping by a `dampratio`, inherited ranges, and the lengths of muscles.
    """
    aligns = [joint.align for joint in spec.joints]
    for joint in spec.joints:  # inertias belong into bodies' own frames, not into aligned ones
        joint.align = 0
    model = spec.compile()
    for joint, align in zip(spec.joints, aligns, strict=True):
        joint.align = align
    spec.compiler.settotalmass = -1
    # What is attached has a compiler of its own.
    for compiler in [spec.compiler, *(body.compiler for body in spec.bodies)]:
        compiler.inertiafromgeom = compiler.boundmass = compiler.boundinertia = 0
        compiler.balanceinertia = False
    for body in spec.bodies[1:]:
        body.explicitinertial, body.fullinertia = True, [float("nan")] * 6
        body.mass, body.inertia = model.body_mass[body.id], model.body_inertia[body.id]
        body.ipos, body.iquat = model.body_ipos[body.id], model.body_iquat[body.id]
    for geom in [*spec.geoms, *(geom.classname.geom for geom in spec.geoms)]:
        if geom.mass > 0:  # it has no effect any more, and would mislead readers of the file
            geom.mass = float("nan")
        if geom.density > 0:
            geom.density = 1000  # MuJoCo's default, which it does not write
    write_down_springs(spec, model)
    for actuator in spec.actuators:
        if actuator.inheritrange:
            actuator.inheritrange = 0
            actuator.ctrlrange = model.actuator_ctrlrange[model.actuator_ctrladr[actuator.id]]
            actuator.actrange = model.actuator_actrange[actuator.id]


def let_inertias_be_rounded(spec: mujoco.MjSpec) -> None:
    """Change inertias by 1e-5 at most, so that MuJoCo accepts them with MJCF's six digits.

    It writes numbers below 1e-12 as 0, and accepts no moment above the sum of the other two, which
    that of a thin plate equals.
    """
    for body in spec.bodies[1:]:
        if body.explicitinertial and body.mass > 0 and np.isnan(body.fullinertia[0]):
            inertia = np.maximum(body.inertia, 1e-11)
            largest = inertia.argmax()
            others = inertia.sum() - inertia[largest]
            inertia[largest] = min(inertia[largest], (1 - 1e-5) * others)
            body.inertia = inertia


def write_down_springs(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Store in a spec the springs and dampers that MuJoCo inferred when it compiled the `model`."""
    for tendon in spec.tendons:
        tendon.springlength = model.tendon_lengthspring[tendon.id]
    for joint in spec.joints:
        if any(joint.springdamper):
            joint.springdamper = [0, 0]
            joint.stiffness[0] = model.jnt_stiffness[joint.id]
            joint.damping[0] = model.dof_damping[model.jnt_dofadr[joint.id]]
    for actuator in spec.actuators:
        actuator.biasprm = model.actuator_biasprm[actuator.id]
        actuator.lengthrange = model.actuator_lengthrange[model.actuator_outadr[actuator.id]]
