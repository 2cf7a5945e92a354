"""Makes values explicit that the compiler infers from shapes, so that tuned shapes do not change
them.
"""

import mujoco


def write_down_inferred(spec: mujoco.MjSpec) -> None:
    """Store in a spec the masses, inertias and spring lengths that follow from nominal shapes."""
    model = spec.compile()
    spec.compiler.inertiafromgeom, spec.compiler.settotalmass = 0, -1
    for body in spec.bodies[1:]:
        body.explicitinertial, body.fullinertia = True, [float("nan")] * 6
        body.mass, body.inertia = model.body_mass[body.id], model.body_inertia[body.id]
        body.ipos, body.iquat = model.body_ipos[body.id], model.body_iquat[body.id]
    for geom in [*spec.geoms, *(geom.classname.geom for geom in spec.geoms)]:
        if geom.mass > 0:  # it has no effect any more, and would mislead readers of the file
            geom.mass = float("nan")
        if geom.density > 0:
            geom.density = 1000  # MuJoCo's default, which it does not write
    for tendon in spec.tendons:
        tendon.springlength = model.tendon_lengthspring[tendon.id]
