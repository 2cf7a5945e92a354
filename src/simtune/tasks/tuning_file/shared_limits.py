"""Limits of actuator forces that joints and tendons have, as URDF's `effort`."""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.parameters.fields import DRIVEN


def limits_of_driven(model: mujoco.MjModel, actuators: Sequence[str]) -> np.ndarray:
    """(actuators, 2) limits of what the actuators drive, as their forces; NaN: none."""
    limits = np.full((len(actuators), 2), np.nan)
    for i, name in enumerate(actuators):
        actuator = model.actuator(name)
        kind, driven = DRIVEN.get(actuator.trntype[0]), actuator.trnid[0]
        gear = actuator.gear[0] if kind == "jnt" else 1.0  # MuJoCo limits a tendon's before it
        if kind and gear and getattr(model, f"{kind}_actfrclimited")[driven]:
            limits[i] = np.sort(getattr(model, f"{kind}_actfrcrange")[driven] / gear)
    return limits


def refuse_shared(model: mujoco.MjModel, actuators: Sequence[str], own: np.ndarray) -> None:
    """Raises InputError where the limit that acts is of several actuators together.

    `own`: (actuators, 2) limits of their own; NaN: none.
    """
    of_driven = limits_of_driven(model, actuators)
    acts = ~np.isnan(of_driven[:, 0])
    acts &= ~((own[:, 0] >= of_driven[:, 0]) & (own[:, 1] <= of_driven[:, 1]))
    kinds = np.array([DRIVEN.get(kind, "") for kind in model.actuator_trntype])
    for name in np.array(actuators)[acts]:
        actuator = model.actuator(name)
        driven = DRIVEN[actuator.trntype[0]]
        same = (kinds == driven) & (model.actuator_trnid[:, 0] == actuator.trnid[0])
        if same.sum() > 1:
            raise InputError(
                f"{name} is one of several actuators whose sum is limited (actuatorfrcrange), so "
                "it has no limit of its own: give it a narrower forcerange in the model, or "
                f"declare {driven}_actfrcrange of what they drive"
            )
