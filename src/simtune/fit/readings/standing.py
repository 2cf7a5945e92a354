"""Robots that stand: a base that no sensor measures begins where its feet are on the ground.

The tuning file says where a base is with the joints of its keyframe. Readings put the joints
elsewhere, such as in legs that sag under an unknown payload, and feet then begin in the ground or
above it: the robot is thrown up or falls, which no parameter explains. So the base is moved until
what touched in the keyframe is as near to each other as it was there.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

_ITERATIONS = 4
_STEP = 1e-5  # m and rad, of differences
_MAX_MOVE = 0.08  # m and rad an iteration: farther, it does not stand
_SINGULAR_RATIO = 1e-2  # to the largest singular value: along the ground nothing tells
_MAX_GAP_M = 1.0  # up to which distances are measured
# Of the farthest pair's distance, at most, that may be left: a robot that walks has lifted a foot,
# and stands on the others
_MAX_LEFT_SHARE = 0.25


def stood(
    model: mujoco.MjModel, states: np.ndarray, settled: np.ndarray, dofs: np.ndarray
) -> np.ndarray:
    """(E, nq + nv) states moved along `dofs` until what touched does so again.

    `settled`: the (nq + nv,) state in which pairs of geoms touch, with distances g of their
    surfaces. With their derivatives J by the base's place, each step δ solves J δ = g_settled − g
    in least squares (Gauss-Newton). A state that so does not come to stand stays as it is.
    """
    if not len(dofs):
        return states
    gaps = _Gaps.touching(model, settled[: model.nq], model.dof_treeid[dofs])
    return np.array([gaps.closed(state, dofs) for state in states]) if gaps.pairs else states


@dataclass(frozen=True)
class _Gaps:
    """Distances of pairs of geoms."""

    model: mujoco.MjModel
    data: mujoco.MjData
    pairs: list[tuple[int, int]]
    usual: np.ndarray  # (P,) metres, in the settled state

    @classmethod
    def touching(cls, model: mujoco.MjModel, place: np.ndarray, trees: np.ndarray) -> "_Gaps":
        """Of the geoms that touch at (nq,) positions: one of the robot's `trees`, one outside."""
        data = mujoco.MjData(model)
        data.qpos[:] = place
        mujoco.mj_fwdPosition(model, data)
        geoms = data.contact.geom[data.contact.geom.min(1) >= 0]  # of flexes it is -1
        is_its = np.isin(model.body_treeid[model.geom_bodyid[geoms]], trees)
        pairs = sorted(set(map(tuple, geoms[is_its.sum(1) == 1].tolist())))
        gaps = cls(model, data, pairs, np.zeros(len(pairs)))
        return replace(gaps, usual=-gaps.left(place))

    def closed(self, state: np.ndarray, dofs: np.ndarray) -> np.ndarray:
        """(nq + nv,) the state, moved; see `stood`."""
        place = state[: self.model.nq]
        left = self.left(place)
        farthest = np.abs(left).max()
        for _ in range(_ITERATIONS):
            moved = [
                self.left(self._moved(place, np.array([dof]), np.array([_STEP]))) for dof in dofs
            ]
            slopes = np.stack([left - its for its in moved], 1) / _STEP
            change = np.linalg.lstsq(slopes, left, rcond=_SINGULAR_RATIO)[0]
            if np.abs(change).max() > _MAX_MOVE:
                return state
            place = self._moved(place, dofs, change)
            left = self.left(place)
        stands = np.abs(left).max() <= _MAX_LEFT_SHARE * farthest
        return np.concatenate([place, state[self.model.nq :]]) if stands else state

    def _moved(self, place: np.ndarray, dofs: np.ndarray, by: np.ndarray) -> np.ndarray:
        """(nq,) positions, moved along dofs by so much."""
        moved, velocity = place.copy(), np.zeros(self.model.nv)
        velocity[dofs] = by
        mujoco.mj_integratePos(self.model, moved, velocity, 1.0)
        return moved

    def left(self, place: np.ndarray) -> np.ndarray:
        """(P,) metres by which pairs are nearer than usual, at (nq,) positions."""
        model, data = self.model, self.data
        data.qpos[:] = place
        mujoco.mj_kinematics(model, data)
        gaps = [mujoco.mj_geomDistance(model, data, *pair, _MAX_GAP_M, None) for pair in self.pairs]
        return self.usual - np.array(gaps)
