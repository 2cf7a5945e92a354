"""What a model needs before it is compiled, so that its parameters can be tuned."""

from collections.abc import Iterator

import mujoco
import numpy as np

from simtune.parameters import Parameter, ParameterSpace
from simtune.parameters.fields import DRIVEN, OF_JOINTS
from simtune.simulation.delays import remember_controls

_DYN = mujoco.mjtDyn
_MIN_GRAVCOMP = 1e-9  # of a weight


def prepare_spec(spec: mujoco.MjSpec, space: ParameterSpace, step_s: float) -> None:
    """Give a model the memory, filters, limits etc. that `space` tunes; idempotent.

    `step_s`: of a policy step.
    """
    remember_controls(spec, space, step_s)
    filter_controls(spec, space)
    compensate_weight(spec, space)
    keep_all_terms(spec, space)
    for parameter, actuator in _actuators(spec, space):
        if parameter.field_info.form == "range":
            _limit_force(spec, actuator, parameter)


def _limit_force(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator, parameter: Parameter) -> None:
    """Give an actuator a limit of its own that `parameter` tunes, and what it drives none.

    A factor multiplies the limit that acts: the narrower one of both.
    """
    ranges = [(actuator.forcelimited, actuator.forcerange)]
    driven = _driven(spec, actuator)
    gear = actuator.gear[0] if actuator.trntype in OF_JOINTS else 1.0
    if driven and gear and parameter.is_factor:
        ranges.append((driven.actfrclimited, np.sort(driven.actfrcrange / gear)))
    acting = [limits for limited, limits in ranges if _acts(limited, limits)]
    if not acting:
        acting = [np.array([-parameter.nominal, parameter.nominal])]
    actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.forcerange = [max(low for low, _ in acting), min(high for _, high in acting)]
    lift_limit(spec, actuator)


def compensate_weight(spec: mujoco.MjSpec, space: ParameterSpace) -> None:
    """Compensate the weight of the bodies whose compensation `space` tunes.

    MuJoCo looks for such bodies only when a model is compiled.
    """
    for parameter in space:
        for name in parameter.objects if parameter.compensates_weight else ():
            if (body := spec.body(name)) and not body.gravcomp:
                body.gravcomp = max(parameter.nominal, _MIN_GRAVCOMP)


def keep_all_terms(spec: mujoco.MjSpec, space: ParameterSpace) -> None:
    """Have MuJoCo compute all terms of bodies whose centres or joints `space` moves.

    It leaves out those that are 0 where nominal centres and joints are at the body's origin.
    """
    for parameter in space:
        info = parameter.field_info
        for name in parameter.objects if info.needs_all_terms else ():
            joint = spec.joint(name) if info.prefix == "jnt" else None
            if body := joint.parent if joint else spec.body(name):
                body.simple = False


def filter_controls(spec: mujoco.MjSpec, space: ParameterSpace) -> None:
    """Let the actuators to which `space` gives a lag follow a filter of their control.

    It is integrated exactly, so that no time constant is too short for the timestep. In keyframes
    the filters have settled on the control.
    """
    lagging = [(p, a) for p, a in _actuators(spec, space) if p.is_lag]
    for _, actuator in lagging:
        if actuator.dyntype == _DYN.mjDYN_FILTER:
            actuator.dyntype = _DYN.mjDYN_FILTEREXACT
    new = [(p, a) for p, a in lagging if a.dyntype == _DYN.mjDYN_NONE]
    if not new:
        return
    model = spec.compile()
    settled = {a.id: int(model.actuator_ctrladr[a.id]) for _, a in new}
    for i, key in enumerate(spec.keys):
        act = []
        for actuator in range(model.nactuator):
            at, num = model.actuator_actadr[actuator], model.actuator_actnum[actuator]
            if actuator in settled:
                act.append(model.key_ctrl[i, settled[actuator]])
            act += list(model.key_act[i, at : at + num]) if num else []
        key.act = np.array(act)
    for parameter, actuator in new:
        actuator.dyntype, actuator.dynprm[0] = _DYN.mjDYN_FILTEREXACT, parameter.nominal


def _actuators(
    spec: mujoco.MjSpec, space: ParameterSpace
) -> Iterator[tuple[Parameter, mujoco.MjsActuator]]:
    """With the parameters that change them; ModelWriter reports unknown ones."""
    for parameter in space:
        for name in parameter.objects if parameter.changes_model else ():
            if actuator := spec.actuator(name):
                yield parameter, actuator


def lift_limit(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> None:
    """Remove the limit of actuator forces of a joint or tendon, where the actuator's replaces it.

    URDF's `effort` is such a limit; beside it, larger ones would not act. It stays where other
    actuators drive the same, since it limits the sum.
    """
    driven = _driven(spec, actuator)
    if driven and sum(_driven(spec, other) == driven for other in spec.actuators) == 1:
        driven.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE


def _driven(
    spec: mujoco.MjSpec, actuator: mujoco.MjsActuator
) -> mujoco.MjsJoint | mujoco.MjsTendon | None:
    kind = DRIVEN.get(int(actuator.trntype))
    if not kind:
        return None
    return spec.joint(actuator.target) if kind == "jnt" else spec.tendon(actuator.target)


def _acts(limited: int, limits: np.ndarray) -> bool:
    if limited == mujoco.mjtLimited.mjLIMITED_AUTO:
        return bool(limits[0] < limits[1])
    return limited == mujoco.mjtLimited.mjLIMITED_TRUE  # all of them are true
