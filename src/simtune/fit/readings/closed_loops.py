"""Joints that a closed loop ties to measured ones: the rocker of a four-bar linkage."""

import mujoco
import numpy as np

from simtune.simulation.ties import dofs_of_ties

_EQ = mujoco.mjtEq
_CLOSING = (_EQ.mjEQ_CONNECT.value, _EQ.mjEQ_WELD.value)
_ITERATIONS, _CLOSED = 12, 1e-9  # of Gauss-Newton, and a step (rad or m) that ends it
_LARGEST_STEP = 0.3  # rad or m: near a dead centre, a longer one may end in the mirrored pose
_PART = 0.1  # rad or m that measured joints are moved at once, for the same reason
_MOST_PARTS = 100
_SINGULAR = 1e-6  # of the largest singular value: MuJoCo's rows of a planar loop are redundant


class ClosedLoops:
    """The loops of a model that active `<connect>` and `<weld>` equalities close.

    Of these, those with measured joints and others. The others are moved until the loop is closed
    (Gauss-Newton over the equalities' residuals); measured ones stay.
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

    def close(self, states: np.ndarray) -> None:
        """Close loops in (n, nq + nv) `states`, each near by."""
        for state in states:
            self._close(state)

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
        num = int(np.clip(np.ceil(np.abs(moved).max(initial=0.0) / _PART), 1, _MOST_PARTS))
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
        self._close(state)

    def _close(self, state: np.ndarray) -> None:
        """Close loops in one (nq + nv) state, which has the other joints' velocities."""
        model, data, passive = self.model, self._data, self._passive
        assert data is not None, "there are loops"
        nq, step = model.nq, np.zeros(model.nv)
        solved = np.zeros((len(passive), 2))
        data.qpos[:] = state[:nq]
        speeds = state[nq:].copy()
        speeds[passive] = 0.0
        for _ in range(_ITERATIONS):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeConstraint(model, data)
            slopes = data.efc_J.reshape(data.nefc, model.nv)
            wanted = -np.stack([data.efc_pos, slopes @ speeds], 1)
            if not (np.isfinite(slopes).all() and np.isfinite(wanted).all()):
                return  # of a world that diverged
            solved = np.linalg.lstsq(slopes[:, passive], wanted, rcond=_SINGULAR)[0]
            size = np.abs(solved[:, 0]).max()
            step[passive] = solved[:, 0] * min(1.0, _LARGEST_STEP / max(size, 1e-300))
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
            if not size > _CLOSED:
                break
        state[:nq] = data.qpos
        state[nq + passive] = solved[:, 1]

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
        if dofs & measured and np.isin(model.eq_type[some], _CLOSING).any():
            ties, tied = ties + some, tied | dofs
    return ties, tied
