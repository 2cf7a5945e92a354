"""A pinhole camera in unit coordinates: its pose and projection.

It is fixed to a body, and points are in that body's frame, so a camera on a robot's wrist is like
one on a wall. The camera looks along its −z, and its y is up.
"""

import functools
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from simtune.cameras.lens import focal_px
from simtune.parameters import ParameterSpace

_LEAST_DEPTH_M = 0.01
_OUTSIDE_PX = -1e4  # pixels of points behind the camera


class Pose(NamedTuple):
    """In the frame of the body that the camera is fixed to."""

    place: np.ndarray  # (3,) m
    turn: np.ndarray  # (3, 3) its axes as columns
    fovy_deg: float  # vertical


@dataclass(frozen=True)
class CameraGeometry:
    """With P parameters: x, y, z, pitch, yaw, roll and, if it is tuned, the field of view."""

    space: ParameterSpace  # of `scene.with_any_camera`
    size: tuple[int, int]  # (height, width) of pictures
    nominal: np.ndarray  # (3, 3) the camera's axes as columns, at angles of 0
    fovy_deg: float  # used if it is not tuned

    @classmethod
    def of(
        cls, model: mujoco.MjModel, camera: str, space: ParameterSpace, size: tuple[int, int]
    ) -> "CameraGeometry":
        given = model.camera(camera)
        turn = Rotation.from_quat(np.roll(given.quat, -1)).as_matrix()
        return cls(space, size, turn, float(given.fovy[0]))

    def pose(self, unit: np.ndarray) -> Pose:
        """At (P,) unit coordinates."""
        values = self._values(unit)
        turns = [_about(axis, angle) for axis, angle in enumerate(values[3:6])]
        fovy_deg = float(values[6]) if len(values) > 6 else self.fovy_deg
        return Pose(values[:3], self.nominal @ turns[0] @ turns[1] @ turns[2], fovy_deg)

    def project(self, unit: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(..., 3) points to (..., 2) pixels, 0 at the first's centre; far outside if behind."""
        pose = self.pose(unit)
        seen = (points - pose.place) @ pose.turn
        depth = np.maximum(-seen[..., 2:], _LEAST_DEPTH_M)
        pixels = self.centre_px + self.focal_px(pose) * seen[..., :2] / depth * [1, -1]
        return np.where(-seen[..., 2:] > _LEAST_DEPTH_M, pixels, _OUTSIDE_PX)

    def lift(self, unit: np.ndarray, pixels: np.ndarray, depths: np.ndarray) -> np.ndarray:
        """(n, 3) points, seen at (n, 2) pixels, (n,) m along the camera's axis."""
        pose = self.pose(unit)
        beside = (pixels - self.centre_px) * [1, -1] / self.focal_px(pose)
        seen = np.concatenate([beside, -np.ones((len(beside), 1))], 1) * depths[:, None]
        return seen @ pose.turn.T + pose.place

    def _values(self, unit: np.ndarray) -> np.ndarray:
        """(P,), also beyond the range."""
        low, length = self._lows_and_ranges
        return low + length * unit

    @functools.cached_property
    def _lows_and_ranges(self) -> np.ndarray:
        """(2, P)."""
        return np.array([[p.low, p.high - p.low] for p in self.space]).T

    @property
    def centre_px(self) -> np.ndarray:
        """(2,) where the camera's axis is."""
        return (np.array(self.size[::-1]) - 1) / 2

    def focal_px(self, pose: Pose) -> np.ndarray:
        """Pixels, for pictures of this size."""
        return focal_px(self.size[0], pose.fovy_deg)


def _about(axis: int, angle: float) -> np.ndarray:
    return Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()
