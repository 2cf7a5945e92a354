"""Actions that displace a mocap body, and what is welded to it."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.errors import InputError, UnknownName
from simtune.simulation.action_numbers import checked_range, finite_range
from simtune.simulation.actions import ActionMapping

_AXES = "xyz"
_WELD, _CONNECT = mujoco.mjtEq.mjEQ_WELD.value, mujoco.mjtEq.mjEQ_CONNECT.value
_SITE = mujoco.mjtObj.mjOBJ_SITE.value


class MocapActions(ActionMapping):
    """An action displaces a mocap body that something is welded to, such as a robot's hand.

    The target is the welded body's present position plus the displacement, within the workspace;
    the mocap body keeps its orientation and its coordinates along other axes. It jumps there at
    once, and the weld pulls. Gravity pulls, too: a robot that carries itself needs gravcomp="1".
    """

    is_relative = True

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        body: str,
        metres_per_unit: float = 1.0,
        axes: str = _AXES,
        action_range: np.ndarray | Sequence | None = None,
        workspace_m: np.ndarray | Sequence | None = None,
    ):
        """`axes` of the world, one per action; `action_range`: (2,) or (A, 2), by default [−1, 1].

        `workspace_m`: (A, 2) lowest and highest position of the mocap body, by default infinite.
        Raises UnknownName, InputError.
        """
        if not axes or len(set(axes)) < len(axes) or not set(axes) <= set(_AXES):
            raise InputError(f"axes must be some of x, y and z, each once, got {axes!r}")
        self.held = find_held(model, body)
        self._axes = [_AXES.index(axis) for axis in axes]
        self.metres_per_unit = metres_per_unit
        self.names = tuple(f"{body} {axis}" for axis in axes)
        self.range = finite_range(action_range, len(axes))
        self.is_limited = np.full(len(axes), True)
        given = (-np.inf, np.inf) if workspace_m is None else workspace_m
        self._workspace = checked_range(given, len(axes))

    def settle(self, batch: Batch) -> None:
        """Move the mocap body to what it holds, which it would else pull away from its start."""
        self.held.compute(batch)
        place = self.held.place(batch)[:, self._axes]
        batch.mocap_pos[:, self.held.mocap, self._axes] = place
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)

    def apply(self, batch: Batch, actions: np.ndarray) -> np.ndarray:
        """See `ActionMapping`; the mocap body moves at once, controls stay."""
        step_m = self.metres_per_unit * np.clip(actions, *self.range.T)
        target = self.held.place(batch)[:, self._axes] + step_m
        batch.mocap_pos[:, self.held.mocap, self._axes] = np.clip(target, *self._workspace.T)
        return batch.ctrl.copy()


@dataclass(frozen=True)
class Held:
    """A mocap body's weld: a point of another body that is pulled to a point of its own."""

    equality: int  # the weld
    mocap: int  # index among the mocap bodies
    mocap_body: int
    mocap_point: np.ndarray  # (3,) in the mocap body's frame, m
    body: int
    point: np.ndarray  # (3,) in the held body's frame, m

    def compute(self, batch: Batch) -> None:
        """Have body positions computed from now on: unbound fields are not."""
        for field in ("xpos", "xmat"):
            batch.bind(field)
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)

    def place(self, batch: Batch) -> np.ndarray:
        """(n, 3) positions where the mocap body, as oriented, would not pull; m, in the world."""
        with np.errstate(invalid="ignore"):  # in diverged worlds
            held = batch.xpos[:, self.body] + _turned(batch, self.body, self.point)
            return held - _turned(batch, self.mocap_body, self.mocap_point)


def find_held(model: mujoco.MjModel, name: str) -> Held:
    """What the mocap body `name` is welded, or connected, to.

    Raises UnknownName if there is no such mocap body, InputError if it holds nothing.
    """
    mocaps = np.flatnonzero(model.body_mocapid >= 0)
    names = {model.body(i).name: int(i) for i in mocaps if model.body(i).name}
    if name not in names:
        if not names:
            raise InputError(
                f'the model has no named mocap body, so none {name!r}: add mocap="true"'
            )
        raise UnknownName("mocap body", name, "the model", names)
    for equality in range(model.neq):
        if model.eq_type[equality] in (_WELD, _CONNECT) and model.eq_active0[equality]:
            ends = _ends(model, equality)
            for (body, point), (other, other_point) in (ends, ends[::-1]):
                if body == names[name]:
                    mocap = int(model.body_mocapid[body])
                    return Held(equality, mocap, body, point, other, other_point)
    raise InputError(f"nothing is welded to mocap body {name!r}: add a <weld> to <equality>")


def _ends(model: mujoco.MjModel, equality: int) -> list[tuple[int, np.ndarray]]:
    """Both bodies of a weld or connection, each with its point, (3,) m in the body's frame."""
    data, ids = model.eq_data[equality], (model.eq_obj1id[equality], model.eq_obj2id[equality])
    if model.eq_objtype[equality] == _SITE:
        return [(int(model.site_bodyid[i]), model.site_pos[i].copy()) for i in ids]
    points = [data[:3].copy(), data[3:6].copy()]
    if model.eq_type[equality] == _WELD:  # a weld's anchor, in the second body's frame, is first
        points.reverse()
    return [(int(body), point) for body, point in zip(ids, points, strict=True)]


def _turned(batch: Batch, body: int, point: np.ndarray) -> np.ndarray:
    """(n, 3) a vector of a body's frame in the world's."""
    return batch.xmat.reshape(batch.nsim, -1, 3, 3)[:, body] @ point
