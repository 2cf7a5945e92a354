"""A mocap body and what hangs on it by a weld."""

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.errors import InputError, UnknownName

_WELD, _CONNECT = mujoco.mjtEq.mjEQ_WELD.value, mujoco.mjtEq.mjEQ_CONNECT.value
_SITE = mujoco.mjtObj.mjOBJ_SITE.value


@dataclass(frozen=True)
class Held:
    """What a mocap body holds: a point of another body that a weld brings to a point of its own."""

    mocap: int  # index among the mocap bodies
    mocap_body: int
    mocap_point: np.ndarray  # (3,) in the mocap body's frame, m
    body: int
    point: np.ndarray  # (3,) in the held body's frame, m

    def compute(self, batch: Batch) -> None:
        """Have the places of bodies computed from now on: what is not bound is not."""
        for field in ("xpos", "xmat"):
            batch.bind(field)
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)

    def place(self, batch: Batch) -> np.ndarray:
        """(n, 3) where the mocap body would pull at nothing, as it is turned; m, of the world."""
        with np.errstate(invalid="ignore"):  # of worlds that diverged
            return _world(batch, self.body, self.point) - _turned(
                batch, self.mocap_body, self.mocap_point
            )


def find_held(model: mujoco.MjModel, name: str) -> Held:
    """What the mocap body `name` is welded, or connected, to.

    Raises UnknownName where there is no such mocap body, InputError where it holds nothing.
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
        if model.eq_type[equality] in (_WELD, _CONNECT):
            ends = _ends(model, equality)
            for (body, point), (other, other_point) in (ends, ends[::-1]):
                if body == names[name]:
                    mocap = int(model.body_mocapid[body])
                    return Held(mocap, body, point, other, other_point)
    raise InputError(f"nothing is welded to mocap body {name!r}: add a <weld> to <equality>")


def _ends(model: mujoco.MjModel, equality: int) -> list[tuple[int, np.ndarray]]:
    """Both bodies of a weld or connection, each with its point, (3,) m in the body's frame."""
    data, ids = model.eq_data[equality], (model.eq_obj1id[equality], model.eq_obj2id[equality])
    if model.eq_objtype[equality] == _SITE:
        return [(int(model.site_bodyid[i]), model.site_pos[i].copy()) for i in ids]
    points = [data[:3].copy(), data[3:6].copy()]
    if model.eq_type[equality] == _WELD:  # there the anchor, in the second body's frame, is first
        points.reverse()
    return [(int(body), point) for body, point in zip(ids, points, strict=True)]


def _world(batch: Batch, body: int, point: np.ndarray) -> np.ndarray:
    """(n, 3) where a body's point is."""
    return batch.xpos[:, body] + _turned(batch, body, point)


def _turned(batch: Batch, body: int, point: np.ndarray) -> np.ndarray:
    """(n, 3) a vector of a body's frame in the world's."""
    return batch.xmat.reshape(batch.nsim, -1, 3, 3)[:, body] @ point
