"""A pinhole camera behind a lens that bends straight lines by one more unknown, k1.

It comes on top of a lens that is declared, whose distortion the film's pictures are rid of already.
"""

from dataclasses import dataclass

import numpy as np

from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.robot import Outlines, Robot
from simtune.cameras.lens import Lens

_MAX_CORNER_BEND = 0.3  # |k1| r² there: straight lines bent by more are no lens's, or folded
_DELTA = 1e-5  # of a direction, for derivatives


@dataclass(frozen=True)
class BentGeometry:
    """With P + 1 unit coordinates: the pinhole's P, and k1 from `-largest` to `largest`."""

    pinhole: CameraGeometry
    lens: Lens  # declared, or the pinhole's own

    @classmethod
    def of(cls, pinhole: CameraGeometry, lens: Lens | None) -> "BentGeometry":
        height, width = pinhole.size
        return cls(pinhole, lens or Lens.pinhole(width, height, pinhole.fovy_deg))

    @property
    def largest(self) -> float:
        """Of |k1|."""
        height, width = self.pinhole.size
        corner = np.hypot(height, width) / 2 / self._focal_px(np.full(len(self.pinhole.space), 0.5))
        return _MAX_CORNER_BEND / float(corner) ** 2

    def k1(self, unit: np.ndarray) -> float:
        """At (P + 1,) unit coordinates."""
        return self.largest * (2 * float(unit[-1]) - 1)

    def project(self, unit: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(..., 3) points to (..., 2) pixels, as `CameraGeometry.project`."""
        return self.bend(unit, self.pinhole.project(unit[:-1], points))

    def bend(self, unit: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """(..., 2) pixels of the pinhole to those of the film."""
        directions = self._directions(unit, pixels)
        return self._pixels(unit, self.lens.bent(directions, self.k1(unit)))

    def stretch(self, unit: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """(n, 2, 2) derivatives of `bend` by each of (n, 2) pixels."""
        directions, k1 = self._directions(unit, pixels), self.k1(unit)
        return np.stack(
            [
                (self.lens.bent(directions + step, k1) - self.lens.bent(directions - step, k1))
                / (2 * _DELTA)
                for step in _DELTA * np.eye(2)
            ],
            -1,
        )

    def _directions(self, unit: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        return (pixels - self.pinhole.centre_px) / self._focal_px(unit[:-1])

    def _pixels(self, unit: np.ndarray, directions: np.ndarray) -> np.ndarray:
        return directions * self._focal_px(unit[:-1]) + self.pinhole.centre_px

    def _focal_px(self, unit: np.ndarray) -> float:
        return float(self.pinhole.focal_px(self.pinhole.pose(unit)))


@dataclass(frozen=True)
class BentRobot:
    """A `Robot` before such a camera."""

    robot: Robot
    geometry: BentGeometry

    def outlines(
        self, unit: np.ndarray, which: np.ndarray, at_most: int, is_rough: bool = False
    ) -> Outlines:
        """As `Robot.outlines`, of those within the film's pictures, for (P + 1,) coordinates."""
        drawn = self.robot.outlines(unit[:-1], which, at_most, is_rough)
        pixels = self.geometry.bend(unit, drawn.pixels)
        # A tangent is stretched as the picture is, so a normal by the inverse's transpose.
        turned = np.linalg.inv(self.geometry.stretch(unit, drawn.pixels))
        normals = np.einsum("nji,nj->ni", turned, drawn.normals)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        height, width = self.geometry.pinhole.size
        inside = ((pixels >= 0) & (pixels <= [width - 1, height - 1])).all(1)
        seen = drawn._replace(pixels=pixels, normals=normals)
        return Outlines(*(values[inside] for values in seen))
