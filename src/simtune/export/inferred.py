"""What a compiler infers from shapes, written down: tuned shapes must not change it."""

import mujoco


def write_down_inferred(spec: mujoco.MjSpec) -> None:
    """Give a spec the masses, inertias and lengths of springs that its nominal shapes have."""
    model = spec.compile()
    spec.compiler.inertiafromgeom, spec.compiler.settotalmass = 0, -1
    for body in spec.bodies[1:]:
        body.explicitinertial, body.fullinertia = True, [float("nan")] * 6
        body.mass, body.inertia = model.body_mass[body.id], model.body_inertia[body.id]
        body.ipos, body.iquat = model.body_ipos[body.id], model.body_iquat[body.id]
    for geom in [*spec.geoms, *(geom.classname.geom for geom in spec.geoms)]:
        if geom.mass > 0:  # a weight that counts no more would mislead whoever edits the file
            geom.mass = float("nan")
        if geom.density > 0:
            geom.density = 1000  # MuJoCo's own, which it does not write
    for tendon in spec.tendons:
        tendon.springlength = model.tendon_lengthspring[tendon.id]
