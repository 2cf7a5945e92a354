"""Coordinates of a model's states, for estimates by a network and for steps of a fit.

A full state, (S,), is MuJoCo's mjSTATE_INTEGRATION: time, positions (nq), velocities (nv), then
what else a step depends on (actuators, controls and their history, warm starts, mocap bodies). No
other module needs to know that layout.
"""

import mujoco
import numpy as np

from simtune.parameters.joint_types import BALL, FREE, HINGE


class StateSpace:
    """Positions and velocities, (..., nq + nv), of one model.

    A tangent, (..., 2 nv), is a small change of both, with rotation vectors in place of
    quaternions. Features, (..., F), are the same state without jumps: sine and cosine for hinges
    without limits.
    """

    def __init__(self, model: mujoco.MjModel):
        self.nq, self.nv = model.nq, model.nv
        endless, self._quaternions, plain = [], [], []
        for joint in range(model.njnt):
            kind, q, v = (
                int(x[joint]) for x in (model.jnt_type, model.jnt_qposadr, model.jnt_dofadr)
            )
            if kind in (BALL, FREE):
                offset = 3 if kind == FREE else 0
                plain += [(q + i, v + i) for i in range(offset)]
                self._quaternions.append((q + offset, v + offset))
            elif kind == HINGE and not model.jnt_limited[joint]:
                endless.append((q, v))
            else:
                plain.append((q, v))
        self._moving = slice(1, 1 + self.nq + self.nv)  # of a full state, which begins with time
        # What actuators remember: activations and past controls
        self.remembered = slice(self._moving.stop, self._moving.stop + model.na + model.nhistory)
        self._plain = np.array(plain, int).reshape(-1, 2)
        self._endless = np.array(endless, int).reshape(-1, 2)

    @property
    def num_tangent(self) -> int:
        """Length of a tangent."""
        return 2 * self.nv

    @property
    def largest_change(self) -> np.ndarray:
        """(2 nv,) half a turn where one more changes nothing, else without an end."""
        largest = np.full(self.num_tangent, np.inf)
        turns = [self._endless[:, 1], *(np.arange(v, v + 3) for _, v in self._quaternions)]
        largest[np.concatenate(turns)] = np.pi
        return largest

    def positions_and_velocities(self, full_states: np.ndarray) -> np.ndarray:
        """(..., nq + nv) of (..., S) full states; a view."""
        return full_states[..., self._moving]

    def with_positions_and_velocities(
        self, full_states: np.ndarray, states: np.ndarray
    ) -> np.ndarray:
        """A copy of (..., S) full states with (..., nq + nv) states; the shapes broadcast."""
        shape = np.broadcast_shapes(full_states.shape[:-1], states.shape[:-1])
        changed = np.broadcast_to(full_states, (*shape, full_states.shape[-1])).copy()
        changed[..., self._moving] = states
        return changed

    def features(self, states: np.ndarray) -> np.ndarray:
        """(..., nq + nv) to (..., F)."""
        q, v = states[..., : self.nq], states[..., self.nq :]
        turned = q[..., self._endless[:, 0]]
        parts = [q[..., self._plain[:, 0]], np.sin(turned), np.cos(turned)]
        for start, _ in self._quaternions:
            quaternion = q[..., start : start + 4]
            parts.append(np.where(quaternion[..., :1] < 0, -quaternion, quaternion))
        return np.concatenate([*parts, v], -1)

    def from_features(self, features: np.ndarray) -> np.ndarray:
        """The inverse of `features`, also for estimates that are no exact features."""
        states = np.zeros((*features.shape[:-1], self.nq + self.nv))
        plain, endless = len(self._plain), len(self._endless)
        states[..., self._plain[:, 0]] = features[..., :plain]
        sine = features[..., plain : plain + endless]
        cosine = features[..., plain + endless : plain + 2 * endless]
        states[..., self._endless[:, 0]] = np.arctan2(sine, cosine)
        at = plain + 2 * endless
        for start, _ in self._quaternions:
            quaternion = features[..., at : at + 4] + [1e-9, 0, 0, 0]
            length = np.linalg.norm(quaternion, axis=-1, keepdims=True)
            states[..., start : start + 4] = quaternion / length
            at += 4
        states[..., self.nq :] = features[..., at:]
        return states

    def move(self, states: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """(..., nq + nv) states changed by (..., 2 nv)."""
        moved = np.broadcast_to(states, (*tangent.shape[:-1], states.shape[-1])).copy()
        for q, v in (*self._plain, *self._endless):
            moved[..., q] += tangent[..., v]
        for q, v in self._quaternions:
            turn = _from_rotation_vector(tangent[..., v : v + 3])
            moved[..., q : q + 4] = _multiply(moved[..., q : q + 4], turn)
        moved[..., self.nq :] += tangent[..., self.nv :]
        return moved

    def difference(self, states: np.ndarray, others: np.ndarray) -> np.ndarray:
        """(..., 2 nv) tangents from `others` to `states`."""
        tangent = np.zeros((*states.shape[:-1], 2 * self.nv))
        for q, v in self._plain:
            tangent[..., v] = states[..., q] - others[..., q]
        for q, v in self._endless:
            turn = states[..., q] - others[..., q]
            tangent[..., v] = (turn + np.pi) % (2 * np.pi) - np.pi
        for q, v in self._quaternions:
            inverse = others[..., q : q + 4] * [1, -1, -1, -1]
            tangent[..., v : v + 3] = _rotation_vector(_multiply(inverse, states[..., q : q + 4]))
        tangent[..., self.nv :] = states[..., self.nq :] - others[..., self.nq :]
        return tangent


def turned_about_vertical(quaternions: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(n, 4) quaternions w, x, y, z, rotated by (n,) rad about the world's z axis."""
    none = np.zeros_like(angle)
    return _multiply(np.stack([np.cos(angle / 2), none, none, np.sin(angle / 2)], 1), quaternions)


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of (..., 4) quaternions."""
    scalar = a[..., :1] * b[..., :1] - (a[..., 1:] * b[..., 1:]).sum(-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], -1)


def _from_rotation_vector(vector: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), vector * np.sinc(angle / 2 / np.pi) / 2], -1)


def _rotation_vector(quaternion: np.ndarray) -> np.ndarray:
    quaternion = np.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    sine = np.linalg.norm(quaternion[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, quaternion[..., :1])
    return quaternion[..., 1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
