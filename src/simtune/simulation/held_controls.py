"""What actuators remember when an episode begins: that servos held still."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.simulation.servos import control_limits, position_servos, pulls_to_a_place

_DYN = mujoco.mjtDyn
_FILTERS = (_DYN.mjDYN_FILTER.value, _DYN.mjDYN_FILTEREXACT.value)
# Activations that controls alone change; others also depend on how the joint moved
_CONTROLLED_DYNAMICS = (*_FILTERS, _DYN.mjDYN_INTEGRATOR.value, _DYN.mjDYN_MUSCLE.value)
_FORGOTTEN_AFTER_LAGS = 5  # time constants of an activation
_FIXED = mujoco.mjtGain.mjGAIN_FIXED.value


class HeldControls:
    """Before an episode, position servos have long been at their first control.

    Filters have settled on it, and delays still bring it. A control of 0, as MuJoCo begins with,
    would first swing a robot to its zero. Motors were off: their controls were 0. What integrates a
    velocity (<intvelocity>) held its joint where that is, unless the start gives it an activation.
    """

    def __init__(self, model: mujoco.MjModel, motors_ran: bool = False):
        """`motors_ran`: motors with filters have long been at their first control, too."""
        is_servo = position_servos(model) & (model.actuator_ctrlnum == 1)
        is_filter = np.isin(model.actuator_dyntype, _FILTERS) & (model.actuator_actnum == 1)
        is_filter &= model.actuator_ctrlnum == 1
        lagging = is_filter & ~is_servo
        self.motors_lag = bool(lagging.any())
        # Seconds after which it no longer matters what acted on motors that ran
        lag_s = model.actuator_dynprm[lagging, 0].max(initial=0)
        self.unsettled_s = _FORGOTTEN_AFTER_LAGS * lag_s if motors_ran else 0.0
        settled = is_servo | (is_filter if motors_ran else False)
        filtered = is_filter & settled
        self._acts = model.actuator_actadr[filtered]
        self._act_controls = model.actuator_ctrladr[filtered]
        places, controls = [], []
        for actuator in np.flatnonzero(settled & (model.actuator_historyadr >= 0)):
            # Layout per actuator: two numbers of bookkeeping, the samples' times, then their values
            num, at = int(model.actuator_history[actuator, 0]), model.actuator_historyadr[actuator]
            places += range(at + 2 + num, at + 2 + 2 * num)
            controls += [model.actuator_ctrladr[actuator]] * num
        self._places, self._place_controls = np.array(places, int), np.array(controls, int)
        self._integrators = _integrators(model)
        self.integrated = model.actuator_actadr[self._integrators]  # (I,) their activations
        of_motion = ~np.isin(model.actuator_dyntype, _CONTROLLED_DYNAMICS) | (
            model.actuator_plugin >= 0
        )
        # Whether what actuators remember also depends on the motion, or on where it began
        self.is_of_motion = bool((of_motion & (model.actuator_actnum > 0)).any())
        self.is_of_motion |= self.integrated.size > 0
        limits = [control_limits(model, control) for control in range(model.nu)]
        self._low, self._high = np.array(limits).reshape(-1, 2).T
        self._model = model

    def holding(self, batch: Batch) -> np.ndarray:
        """(n, I) activations at which integrators pull at nothing, in n worlds at rest.

        Reads lengths: as an `observe`, call it once before the worlds start.
        """
        ids, model = self._integrators, self._model
        if not ids.size:
            return np.zeros((batch.nsim, 0))
        length = batch.actuator_length[:, model.actuator_outadr[ids]]
        bias, gain = model.actuator_biasprm[ids], model.actuator_gainprm[ids, 0]
        limited = np.asarray(model.actuator_actlimited, bool)[ids]
        low, high = model.actuator_actrange[ids].T
        held: np.ndarray = -(bias[:, 0] + bias[:, 1] * length) / gain
        return np.where(limited, np.clip(held, low, high), held)

    def follow(self, batch: Batch, before: np.ndarray) -> None:
        """Move activations that a keyframe gave as joints were moved; (n, I) `holding` `before`."""
        if self.integrated.size:
            are_given = given(batch.act[:, self.integrated])
            batch.act[:, self.integrated] += are_given * (self.holding(batch) - before)

    def settle(self, batch: Batch, controls: np.ndarray) -> None:
        """Set the memory of worlds whose first (n, nu) controls these are."""
        within = np.clip(controls, self._low, self._high)
        if self._acts.size:
            batch.act[:, self._acts] = within[:, self._act_controls]
        if self.integrated.size:
            begun = batch.act[:, self.integrated]
            batch.act[:, self.integrated] = np.where(given(begun), begun, self.holding(batch))
        if self._places.size:
            batch.history[:, self._places] = within[:, self._place_controls]


def _integrators(model: mujoco.MjModel) -> np.ndarray:
    """Ids of actuators that pull a joint to the integral of their control."""
    scales = (model.actuator_gaintype == _FIXED) & (model.actuator_gainprm[:, 0] != 0)
    integrates = model.actuator_dyntype == _DYN.mjDYN_INTEGRATOR.value
    return np.flatnonzero(integrates & pulls_to_a_place(model) & scales)


def given(activations: np.ndarray) -> np.ndarray:
    """(n, 1) bool of (n, I): whether a keyframe gives them; all are 0 without."""
    return np.any(activations, axis=1, keepdims=True)
