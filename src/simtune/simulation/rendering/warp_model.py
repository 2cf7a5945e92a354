"""MuJoCo Warp's copy of a model, from which pictures are drawn."""

import copy

import mujoco
import mujoco_warp

from simtune.errors import InputError


def put_model(model: mujoco.MjModel) -> mujoco_warp.Model:
    """Warp's copy, for drawing only. Raises InputError for a model that Warp refuses.

    Physics is MuJoCo's own, so solvers, flags and actuators that Warp lacks are not asked for.
    """
    model = copy.copy(model)
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_AUTO
    model.opt.disableflags = model.opt.enableflags = 0
    model.actuator_gaintype[:] = mujoco.mjtGain.mjGAIN_FIXED
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_NONE
    model.actuator_dyntype[:] = mujoco.mjtDyn.mjDYN_NONE
    try:
        return mujoco_warp.put_model(model)
    except (NotImplementedError, ValueError) as error:
        raise InputError(
            f"the ray caster cannot draw the model, since MuJoCo Warp lacks something of it "
            f"({error}): take that out of the model, or use no camera"
        ) from error
