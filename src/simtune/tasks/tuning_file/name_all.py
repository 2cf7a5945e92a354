"""Names for a model's unnamed objects, so that all can be referred to by name."""

import mujoco


def name_all(spec: mujoco.MjSpec) -> None:
    """Give unnamed objects names such as "geom 12", with the index in the compiled model.

    Raises ValueError if MuJoCo cannot compile the model.
    """
    spec.compile()
    plurals = {"body": "bodies", "equality": "equalities", "keyframe": "keys"}
    kinds = ["joint", "geom", "site", "camera", "light", "tendon", "actuator"]
    for kind in [*plurals, *kinds]:
        elements = list(getattr(spec, plurals.get(kind, f"{kind}s")))
        taken = {element.name for element in elements}
        for element in elements:
            name = f"{kind} {element.id}"
            if not element.name and element.id >= 0 and name not in taken:
                element.name = name
