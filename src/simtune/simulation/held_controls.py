"""What actuators remember when an episode begins: that servos held still."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.simulation.servos import position_servos

_DYN = mujoco.mjtDyn
_FILTERS = (_DYN.mjDYN_FILTER.value, _DYN.mjDYN_FILTEREXACT.value)


class HeldControls:
    """Before an episode, position servos have long been at their first control.

    Filters have settled on it, and delays still bring it. A control of 0, as MuJoCo begins with,
    would first swing a robot to its zero. Motors were off: their controls were 0.
    """

    def __init__(self, model: mujoco.MjModel):
        is_servo = position_servos(model) & (model.actuator_ctrlnum == 1)
        is_filter = np.isin(model.actuator_dyntype, _FILTERS) & (model.actuator_actnum == 1)
        filtered = is_servo & is_filter
        self._acts = model.actuator_actadr[filtered]
        self._act_controls = model.actuator_ctrladr[filtered]
        places, controls = [], []
        for actuator in np.flatnonzero(is_servo & (model.actuator_historyadr >= 0)):
            # Layout per actuator: two numbers of bookkeeping, the samples' times, then their values
            num, at = int(model.actuator_history[actuator, 0]), model.actuator_historyadr[actuator]
            places += range(at + 2 + num, at + 2 + 2 * num)
            controls += [model.actuator_ctrladr[actuator]] * num
        self._places, self._place_controls = np.array(places, int), np.array(controls, int)
        limited = np.asarray(model.actuator_ctrllimited, bool)
        self._low, self._high = np.full(model.nu, -np.inf), np.full(model.nu, np.inf)
        self._low[limited], self._high[limited] = model.actuator_ctrlrange[limited].T

    def settle(self, batch: Batch, controls: np.ndarray) -> None:
        """Set the memory of worlds whose first (n, nu) controls these are."""
        within = np.clip(controls, self._low, self._high)
        if self._acts.size:
            batch.act[:, self._acts] = within[:, self._act_controls]
        if self._places.size:
            batch.history[:, self._places] = within[:, self._place_controls]
