"""Action mappings: actions are controls, scaled controls, or displacements of joints or a body.

Actions are what recordings hold and policies give. `Simulator.play` passes them to a mapping, once
per policy step; no other module knows about controls. A mapping is made for a model, so a task
holds its factory: `DirectActions`, or `functools.partial(MocapActions, body="hand", ...)`.

A mapping is stateless: an action's effect depends on the present state only, because a fit replays
stretches from the middle of episodes.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.errors import InputError, UnknownName
from simtune.parameters.joint_types import HINGE_OR_SLIDE
from simtune.simulation.action_numbers import each, finite_range
from simtune.simulation.servos import actuator_name, is_clipped, position_servos

_JOINT = mujoco.mjtTrn.mjTRN_JOINT.value


class ActionSpace(Protocol):
    """The available actions."""

    names: tuple[str, ...]  # (A,) what each moves
    range: np.ndarray  # (A, 2) lowest and highest: for random actions and policies
    is_limited: np.ndarray  # (A,) bool: actions beyond the range are clipped
    is_relative: bool = False  # to the present position of what they move


class ActionMapping(ActionSpace, Protocol):
    """Maps (n, A) actions to the controls of n worlds."""

    def settle(self, batch: Batch) -> None:
        """Move what actions displace to where a fresh start has it; controls need no start."""

    def apply(self, batch: Batch, actions: np.ndarray) -> np.ndarray:
        """The (n, nu) controls for the next policy step; anything else is moved at once."""
        ...


MapActions = Callable[[mujoco.MjModel], ActionMapping]


class DirectActions(ActionMapping):
    """An action is a control."""

    def __init__(self, model: mujoco.MjModel, *, actuators: Sequence[str] | None = None):
        """`actuators`: whose controls, in the actions' order; None: all, in the model's order.

        The other actuators keep their initial control. Raises UnknownName, InputError.
        """
        ids, self.names = _actuators(model, actuators)
        self._controls = model.actuator_ctrladr[ids]
        self.range, _ = _control_range(model, self._controls)
        self.is_limited = is_clipped(model)[self._controls]

    def apply(self, batch: Batch, actions: np.ndarray) -> np.ndarray:
        """See `ActionMapping`."""
        return _among_others(batch, self._controls, actions)


class ScaledActions(ActionMapping):
    """A control is offset + gain · action; without a gain, actions' ranges cover the controls'."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        actuators: Sequence[str] | None = None,
        action_range: np.ndarray | Sequence | None = None,
        gain: np.ndarray | Sequence[float] | float | None = None,
        offset: np.ndarray | Sequence[float] | float = 0.0,
    ):
        """`action_range`: (2,) or (A, 2); `gain`, `offset`: numbers or (A,). Actuators as above.

        By default the range is [−1, 1], or, with a gain, what covers the control's range if that is
        limited. Raises UnknownName, InputError.
        """
        ids, self.names = _actuators(model, actuators)
        self._controls = model.actuator_ctrladr[ids]
        controls, has_range = _control_range(model, self._controls)
        self.is_limited = is_clipped(model)[self._controls]
        if gain is None:
            if not has_range.all():
                name = self.names[has_range.argmin()]
                raise InputError(f"{name} has no ctrlrange for the actions to cover: give a gain")
            self.range = finite_range(action_range, len(ids))
            self._gain = np.ptp(controls, axis=1) / np.ptp(self.range, axis=1)
            self._offset = controls[:, 0] - self._gain * self.range[:, 0]
        else:
            self._gain, self._offset = each("gain", gain, ids), each("offset", offset, ids)
            if not self._gain.all():
                raise InputError("a gain of 0 moves nothing: leave that actuator out")
            covering = np.sort((controls - self._offset[:, None]) / self._gain[:, None], axis=1)
            usual = np.where(has_range[:, None], covering, [-1.0, 1.0])
            is_given = action_range is not None
            self.range = finite_range(action_range, len(ids)) if is_given else usual
            self.is_limited &= not is_given

    def apply(self, batch: Batch, actions: np.ndarray) -> np.ndarray:
        """See `ActionMapping`."""
        return _among_others(batch, self._controls, self._offset + self._gain * actions)


class JointActions(ActionMapping):
    """An action displaces a joint from its present position: that is the target of its servo.

    As for a real robot that is sent a little farther than its measured position.
    """

    is_relative = True

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        actuators: Sequence[str] | None = None,
        per_unit: np.ndarray | Sequence[float] | float = 1.0,
        action_range: np.ndarray | Sequence | None = None,
    ):
        """`per_unit`: rad or m by an action of 1, a number or (A,). The others are as above.

        Raises UnknownName, InputError, also for an actuator that moves no hinge or slide, or that
        is no position servo.
        """
        ids, self.names = _actuators(model, actuators)
        self._controls, self._outputs = model.actuator_ctrladr[ids], model.actuator_outadr[ids]
        joints = model.actuator_trnid[ids, 0]
        for name, kind, joint in zip(self.names, model.actuator_trntype[ids], joints, strict=True):
            if kind != _JOINT or model.jnt_type[joint] not in HINGE_OR_SLIDE:
                raise InputError(f"{name} moves no hinge and no slide, so it displaces none")
        # Its force depends on the joint's distance from the control, as of MuJoCo's <position>
        bias, gain = model.actuator_biasprm[ids], model.actuator_gainprm[ids, 0]
        is_servo = position_servos(model)[ids] & (bias[:, 0] == 0) & np.isclose(gain, -bias[:, 1])
        for name, is_one in zip(self.names, is_servo, strict=True):
            if not is_one:
                raise InputError(
                    f"{name} is no servo of positions (<position>), so it displaces nothing: "
                    "use another mapping"
                )
        self._places = model.jnt_qposadr[joints]
        self._per_unit = each("per_unit", per_unit, ids)
        self.range = finite_range(action_range, len(ids))
        self.is_limited = np.full(len(ids), True)

    def apply(self, batch: Batch, actions: np.ndarray) -> np.ndarray:
        """See `ActionMapping`; displacements are clipped to the range."""
        wanted = self._per_unit * np.clip(actions, *self.range.T)
        gear = batch.expand("actuator_gear")[:, self._outputs, 0]  # each world's own
        targets = gear * (batch.qpos[:, self._places] + wanted)
        return _among_others(batch, self._controls, targets)


def _actuators(
    model: mujoco.MjModel, chosen: Sequence[str] | None
) -> tuple[np.ndarray, tuple[str, ...]]:
    """(A,) ids and names of the chosen actuators; None: of all that have controls.

    Raises UnknownName for one that the model lacks, InputError for one that is named twice or has
    not one control.
    """
    known = [model.actuator(i).name for i in range(model.nactuator)]
    names = chosen or ()
    for i, name in enumerate(names):
        if name not in known:
            raise UnknownName("actuator", name, "the model", [k for k in known if k])
        if name in names[:i]:
            raise InputError(f"actuator {name!r} is named twice")
    ids = np.array([known.index(name) for name in names], int)
    if chosen is None:
        ids = np.flatnonzero(model.actuator_ctrlnum)
    names = tuple(actuator_name(model, i) for i in ids.tolist())
    for name, num in zip(names, model.actuator_ctrlnum[ids], strict=True):
        if num != 1:
            raise InputError(
                f"actuator {name!r} has {num} controls, and an action is one: leave it out, by "
                "actuators = [...] with the names of the others"
            )
    return ids, names


def _control_range(model: mujoco.MjModel, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(A, 2) of the controls, [−1, 1] where the model has none; (A,) whether it has one."""
    has_range = np.asarray(model.actuator_ctrllimited, bool)[places]
    return np.where(has_range[:, None], model.actuator_ctrlrange[places], [-1.0, 1.0]), has_range


def _among_others(batch: Batch, places: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """(n, nu) with (n, A) controls at some places, and unchanged ones at the others."""
    merged = batch.ctrl.copy()
    merged[:, places] = controls
    return merged
