"""Joints that a closed loop ties to measured ones: the rocker of a four-bar linkage."""

import functools

import mujoco
import numpy as np

from simtune.simulation.ties import dofs_of_ties

_EQ = mujoco.mjtEq
_LOOP_EQUALITIES = (_EQ.mjEQ_CONNECT.value, _EQ.mjEQ_WELD.value)
_ITERATIONS, _CONVERGED_STEP = 12, 1e-9  # of Gauss-Newton, and a step (rad or m) that ends it
_LARGEST_STEP = 0.3  # rad or m: near a dead centre, a longer one may end in the mirrored pose
_MAX_MEASURED_STEP = 0.1  # rad or m, at once, for the same reason
_MOST_PARTS = 100
_SINGULAR_RATIO = 1e-6  # to the largest singular value: rows of a planar loop are redundant
# The same for velocities, whatever their units: nearer to a dead centre, where links lie on one
# line, noise of the measured ones would be all that the others show
_DEAD_CENTRE_RATIO = 0.02
_RANDOM_POSE_STD = 0.1  # rad or m: from a pose in which a loop may happen to be singular


class ClosedLoops:
    """The loops of a model that active `<connect>` and `<weld>` equalities close.

    Only loops with both measured and unmeasured joints. The unmeasured ones are moved until the
    loop is closed (Gauss-Newton over the equalities' residuals).
    """

    def __init__(self, model: mujoco.MjModel, places: np.ndarray, dofs: np.ndarray):
        """`places`, `dofs`: indices of measured positions and of their velocities."""
        self.model = model.__copy__()  # of the worlds to come; parameters may be written into it
        self._places, self._dofs = places, dofs
        ties, tied = _loops(model, set(dofs.tolist()))
        self._ties = np.array(ties, int)
        self._passive = np.setdiff1d(np.array(sorted(tied), int), dofs)
        if not self._passive.size:
            self._ties = self._ties[:0]
        self._data = self._with_loops_alone() if self else None

    def __bool__(self) -> bool:
        return self._ties.size > 0

    @functools.cached_property
    def placed_joints(self) -> list[int]:
        """Unmeasured joints that loops place; none if a loop leaves one of them open."""
        model, data = self.model, self._data
        if data is None:
            return []
        data.qpos[:] = model.qpos0
        somewhere = np.random.default_rng(0).normal(0, _RANDOM_POSE_STD, model.nv)
        mujoco.mj_integratePos(model, data.qpos, somewhere, 1.0)
        slopes = self._slopes(data)[:, self._passive]
        singular = _SINGULAR_RATIO * np.abs(slopes).max()
        if np.linalg.matrix_rank(slopes, tol=singular) < slopes.shape[1]:
            return []
        return np.unique(model.dof_jntid[self._passive]).tolist()

    def close(self, states: np.ndarray) -> None:
        """Close loops in (n, nq + nv) `states`, each near by."""
        for state in states:
            self._close(state, _DEAD_CENTRE_RATIO)

    def follow(self, states: np.ndarray, begun: np.ndarray) -> None:
        """Close loops in (E, T, nq + nv) `states`, which follow each other from `begun` on.

        A loop has several poses for the same measured joints, and keeps to one as it moves.
        """
        for episode in states:
            last = begun
            for state in episode:
                self._travel(last, state)
                last = state

    def _travel(self, last: np.ndarray, state: np.ndarray) -> None:
        """Close loops in a state, by a few poses between it and the `last` one.

        Each pose is predicted along the loops' tangent, which passes where a parallelogram is flat.
        """
        model, nq = self.model, self.model.nq
        moved = state[self._places] - last[self._places]
        num = int(
            np.clip(np.ceil(np.abs(moved).max(initial=0.0) / _MAX_MEASURED_STEP), 1, _MOST_PARTS)
        )
        between = last.copy()
        between[nq:] = 0.0
        between[nq + self._dofs] = moved / num
        for _ in range(num):
            self._close(between)
            tangent = between[nq:].clip(-_LARGEST_STEP, _LARGEST_STEP)
            mujoco.mj_integratePos(model, between[:nq], tangent, 1.0)
        joints = model.dof_jntid[self._passive]
        ends = np.append(model.jnt_qposadr, nq)
        for start, end in zip(ends[joints], ends[joints + 1], strict=True):
            state[start:end] = between[start:end]
        state[nq + self._passive] = last[nq + self._passive]
        self._close(state, _DEAD_CENTRE_RATIO)

    def _close(self, state: np.ndarray, singular: float = _SINGULAR_RATIO) -> None:
        """Close loops in one (nq + nv) state, which has the other joints' velocities.

        Velocities that it tells `singular` times as well as others, or worse, stay as they are.
        """
        model, data, passive = self.model, self._data, self._passive
        assert data is not None, "there are loops"
        nq, step, slopes = model.nq, np.zeros(model.nv), np.empty((0, model.nv))
        data.qpos[:] = state[:nq]
        for _ in range(_ITERATIONS):
            slopes = self._slopes(data)
            if not (np.isfinite(slopes).all() and np.isfinite(data.efc_pos).all()):
                return  # of a world that diverged
            moved = np.linalg.lstsq(slopes[:, passive], -data.efc_pos, rcond=_SINGULAR_RATIO)[0]
            size = np.abs(moved).max()
            step[passive] = moved * min(1.0, _LARGEST_STEP / max(size, 1e-300))
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
            if not size > _CONVERGED_STEP:
                break
        state[:nq] = data.qpos
        opening = slopes @ state[nq:]
        if np.isfinite(opening).all():
            size = np.maximum(np.linalg.norm(slopes[:, passive], axis=0), 1e-300)  # of rad and m
            change = np.linalg.lstsq(slopes[:, passive] / size, -opening, rcond=singular)[0]
            state[nq + passive] += change / size

    def _slopes(self, data: mujoco.MjData) -> np.ndarray:
        """(rows, nv) derivatives of how far the loops are open, which is in `data.efc_pos`."""
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_makeConstraint(self.model, data)
        return data.efc_J.reshape(data.nefc, self.model.nv)

    def _with_loops_alone(self) -> mujoco.MjData:
        """Data of the model, in which nothing else constrains any joint."""
        options, off = self.model.opt, mujoco.mjtDisableBit
        options.jacobian = mujoco.mjtJacobian.mjJAC_DENSE.value
        for kind in (off.mjDSBL_CONTACT, off.mjDSBL_FRICTIONLOSS, off.mjDSBL_LIMIT):
            options.disableflags |= kind.value
        data = mujoco.MjData(self.model)
        data.eq_active[:] = np.isin(np.arange(self.model.neq), self._ties)
        return data


def _loops(model: mujoco.MjModel, measured: set[int]) -> tuple[list[int], set[int]]:
    """Equalities that tie joints to measured ones in closed loops, and all velocities in these."""
    left = dofs_of_ties(model)
    ties, tied = list[int](), set[int]()
    while left:
        some, dofs = [], set[int]()
        grown = [next(iter(left))]
        while grown:
            some += grown
            dofs = dofs.union(*(left.pop(tie) for tie in grown))
            grown = [tie for tie, its in left.items() if its & dofs]
        if dofs & measured and np.isin(model.eq_type[some], _LOOP_EQUALITIES).any():
            ties, tied = ties + some, tied | dofs
    return ties, tied
