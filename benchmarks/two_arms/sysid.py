"""The same readings, fitted by `mujoco.sysid`, which MuJoCo brings along.

It asks for more than simtune does: pip install "mujoco[sysid]". It knows no pictures, so what only
they show is left out. An offset of each encoder and one delay of all are found along, as simtune
does; the box begins where the keyframe has it.
"""

import contextlib
import io
import logging
import os
import time
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from simtune.parameters import Parameter
from simtune.tasks import Task
from simtune.trajectory import Trajectory

_LARGEST_OFFSET_RAD, _LONGEST_DELAY_S = 0.1, 0.1
_FIRST_DELAY_S = 0.01  # at 0, a bound, it might stay
_ITERATIONS = 60
_MISSED = 0.1  # of intervals, by chance


def fit(task: Task, trajectories: Sequence[Trajectory], left_out: Sequence[str]) -> dict[str, Any]:
    """{parameter: {"mean", "low", "high"}} and seconds; of all but what shows nowhere."""
    from mujoco import sysid  # optional: only here

    began_s = time.monotonic()
    logging.disable(logging.WARNING)
    spec, (sensor,) = task.spec_for(), task.sensors
    for joint in sensor.joints:
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint,
            name=f"{joint}_pos",
        )
    model = spec.compile()
    params, transform = sysid.ParameterDict(), sysid.SignalTransform(normalize=False)
    found = [p for p in task.parameters if not p.is_appearance and p.name not in left_out]
    for p in found:
        modifier = _writer(p)
        params.add(sysid.Parameter(p.name, p.nominal, p.low, p.high, modifier=modifier))
    for joint in sensor.joints:
        most = _LARGEST_OFFSET_RAD
        params.add(sysid.Parameter(f"offset {joint}", 0.0, -most, most))
        transform.bias(f"{joint}_pos", params[f"offset {joint}"], target="predicted")
    params.add(sysid.Parameter("delay", _FIRST_DELAY_S, 0.0, _LONGEST_DELAY_S))
    transform.delay("*_pos", params["delay"])
    sequences = sysid.ModelSequences(
        "two arms",
        spec,
        [f"episode {i}" for i in range(len(trajectories))],
        *zip(*(_sequence(sysid, model, task, t) for t in trajectories), strict=True),
    )
    residual_fn = sysid.build_residual_fn(
        models_sequences=[sequences],
        modify_residual=transform.apply,
        n_threads=len(os.sched_getaffinity(0)),
    )
    with contextlib.redirect_stdout(io.StringIO()):
        best, result = sysid.optimize(
            params, residual_fn, verbose=False, x_scale="jac", max_iters=_ITERATIONS
        )
        left, _, _ = residual_fn(result.x, best)
    _, half = sysid.calculate_intervals(left, result.jac, alpha=_MISSED)
    means = [float(best[p.name].value[0]) for p in found]
    estimates = {
        p.name: {"mean": mean, "low": mean - width, "high": mean + width}
        for p, mean, width in zip(found, means, np.nan_to_num(half, nan=np.inf), strict=False)
    }
    return {"parameters": estimates, "wall_s": time.monotonic() - began_s, "warnings": []}


def _writer(parameter: Parameter) -> Callable[[mujoco.MjSpec, Any], None]:
    """What writes a value into a specification."""
    (name,) = parameter.objects

    def write(spec: mujoco.MjSpec, its: Any) -> None:
        value = float(its.value[0])
        if parameter.field == "dof_frictionloss":
            spec.joint(name).frictionloss = value
        elif parameter.field == "actuator_gainprm":
            spec.actuator(name).gainprm[0] = value
            spec.actuator(name).biasprm[1] = -value
        elif parameter.field == "actuator_biasprm":
            spec.actuator(name).biasprm[2] = -value
        else:
            raise ValueError(f"tune.toml tunes {parameter.field}, which this comparison cannot")

    return write


def _sequence(
    sysid: Any, model: mujoco.MjModel, task: Task, trajectory: Trajectory
) -> tuple[Any, Any, Any]:
    """(initial state, control, readings) of an episode that begins as its first readings say."""
    (sensor,) = task.sensors
    readings = trajectory.readings[sensor.name]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[sensor.places] = readings[0]
    state = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
    repeat = round(task.step_s / model.opt.timestep)
    held = np.repeat(trajectory.actions.astype(float), repeat, axis=0)
    held = np.vstack([held, held[-1:]])  # the last one is not played
    control_s = np.arange(len(held)) * model.opt.timestep
    control = sysid.TimeSeries.from_control_names(control_s, held, model)
    read_s = np.arange(len(readings)) * task.step_s
    return state, control, sysid.TimeSeries.from_names(read_s, readings, model)
