"""Names for what has none in a model, so that all can be asked for by name."""

import mujoco


def name_all(spec: mujoco.MjSpec) -> None:
    """Call "geom 12", by its index in the compiled model, what has no name.

    Raises ValueError where MuJoCo cannot compile the model.
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
