"""A camera's lens, and the pinhole to which its pictures are converted.

For a region of interest, the pinhole looks at its middle, turned about the camera's position.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from simtune.cameras.distortion import check_spread, distort, undistort
from simtune.errors import InputError

_OPENCV = np.diag([1.0, -1.0, -1.0])  # axes of OpenCV in those of MuJoCo's camera
_SQUARE_TOLERANCE, _CENTRE_TOLERANCE_PX = 1e-3, 0.5  # the former is relative
_BORDER = np.linspace(-1, 1, 65)  # places along each side that have to be within the picture
_BORDER_TOLERANCE_PX = 0.01  # for rounding
_TRIED_SHARES = np.linspace(1, 0, 1001)  # of a rectified picture's sides
# Of a picture's side, by its focal length; a fisheye lens of 180° has 115°
_NARROWEST_DEG, _WIDEST_DEG = 5.0, 140.0


@dataclass(frozen=True)
class Lens:
    """OpenCV's camera model: a point at (x, y, 1) before the camera is seen at pixel (u, v).

        u = fx x' + cx    v = fy y' + cy    (x', y') as `distort` says

    x to the right, y down; the middle of the first pixel is at (0, 0). (OpenCV 4, calib3d.)
    """

    width: int  # pixels, of the pictures used for calibration
    height: int
    fx: float  # pixels
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0,) * 5  # k1, k2, p1, p2, k3
    # left, top, right and bottom edge of the used part, in pixels from the corner; None: all
    region: tuple[float, float, float, float] | None = None
    is_calibrated: bool = True  # False: the model's own pinhole, declared for a region alone

    @classmethod
    def pinhole(cls, width: int, height: int, fovy_deg: float) -> "Lens":
        """Without distortion. `fovy_deg`: vertical field of view."""
        focal = float(focal_px(height, fovy_deg))
        middle = (width - 1) / 2, (height - 1) / 2
        return cls(width, height, focal, focal, *middle, is_calibrated=False)

    @property
    def is_pinhole(self) -> bool:
        """Whether the whole picture is a pinhole's that looks at its middle."""
        middle = (self.width - 1) / 2, (self.height - 1) / 2
        away = max(abs(self.cx - middle[0]), abs(self.cy - middle[1]))
        is_square = math.isclose(self.fx, self.fy, rel_tol=_SQUARE_TOLERANCE)
        return not any(self.distortion) and is_square and away <= _CENTRE_TOLERANCE_PX

    @property
    def whole_fovy_deg(self) -> float:
        """Vertical field of view of the whole picture; for a pinhole."""
        return math.degrees(2 * math.atan(self.height / 2 / self.fy))

    def check(self) -> None:
        """Raises InputError for a lens that gives no picture, or one of an implausible angle."""
        if self.is_calibrated:
            self._check_angles()
        _ = self.half_sides

    def _check_angles(self) -> None:
        for name, side, (pixels, _, focal) in zip(
            ("fx", "fy"), ("width", "height"), self._axes, strict=True
        ):
            angle_deg = math.degrees(2 * math.atan(pixels / 2 / focal))
            if not _NARROWEST_DEG <= angle_deg <= _WIDEST_DEG:
                raise InputError(
                    f"{name} of {focal:g} pixels and a {side} of {pixels} make a field of view of "
                    f"{angle_deg:.3g}°; expected {_NARROWEST_DEG:g} to {_WIDEST_DEG:g}°: is {name} "
                    "of a picture of another size? Give width and height of the pictures that it "
                    "was calibrated with"
                )

    @functools.cached_property
    def turn(self) -> Rotation:
        """Rotation from directions before the pinhole to those before the lens.

        In OpenCV's axes: x to the right, y down, z ahead. It does not roll.
        """
        if self.region is None:
            return Rotation.identity()
        left, top, right, bottom = self.region
        x, y = self._towards([(left + right) / 2, (top + bottom) / 2])
        return Rotation.from_rotvec(math.atan(math.hypot(x, y)) * _unit(np.array([-y, x, 0.0])))

    def towards_region(self, quaternion: Sequence[float]) -> list[float]:
        """(4,) w, x, y, z of MuJoCo's camera behind this lens, to one that looks at the region."""
        return _times(quaternion, self._turn_of_mujoco)

    def from_region(self, quaternion: Sequence[float]) -> list[float]:
        """The inverse of `towards_region`."""
        return _times(quaternion, self._turn_of_mujoco.inv())

    @property
    def _turn_of_mujoco(self) -> Rotation:
        return Rotation.from_matrix(_OPENCV @ self.turn.as_matrix() @ _OPENCV)

    @functools.cached_property
    def half_sides(self) -> tuple[float, float]:
        """Half the width and half the height of the rectified picture, at unit distance.

        The axis of `turn` is in its middle, and it shows nothing from beyond the lens's picture.
        Raises InputError if there is no picture.
        """
        whole = self._around_the_axis() if self.region is None else self._around_the_region()
        return self._within_the_picture(whole)

    def _within_the_picture(self, half_sides: tuple[float, float]) -> tuple[float, float]:
        """The largest of the same shape, whose corners are in the lens's picture as well.

        They may not be if the lens is a pincushion, or the region at the picture's edge.
        """
        side = np.stack([_BORDER, np.ones_like(_BORDER)], -1)
        border = np.concatenate([side, -side, side[:, ::-1], -side[:, ::-1]]) * half_sides
        share = next(share for share in _TRIED_SHARES if self._sees(share * border))
        ahead = self._ahead(share * border)
        check_spread(self.distortion, float(np.hypot(ahead[:, 0], ahead[:, 1]).max()))
        return float(share * half_sides[0]), float(share * half_sides[1])

    def _sees(self, points: np.ndarray) -> bool:
        """Whether the picture shows all of these (N, 2) points of the rectified one."""
        seen, size = self.seen_px(points), np.array([self.width, self.height])
        return bool(((seen >= -_BORDER_TOLERANCE_PX) & (seen <= size + _BORDER_TOLERANCE_PX)).all())

    def _around_the_region(self) -> tuple[float, float]:
        assert self.region is not None
        left, top, right, bottom = self.region
        if not (0 <= left < right <= self.width and 0 <= top < bottom <= self.height):
            raise InputError(
                f"region {list(self.region)} is not within the picture of {self.width}×"
                f"{self.height}; expected left, top, right and bottom edge, in pixels"
            )
        x, y = (left + right) / 2, (top + bottom) / 2
        edges = self._towards(np.array([[left, y], [right, y], [x, top], [x, bottom]]))
        seen = self.turn.inv().apply(np.column_stack([edges, np.ones(4)]))
        seen = np.abs(seen[:, :2] / seen[:, 2:])
        return float(seen[:2, 0].min()), float(seen[2:, 1].min())

    def _towards(self, corner_px) -> np.ndarray:
        """(..., 2) directions of points that are `corner_px` from the picture's corner."""
        middle, focal = np.array([self.cx, self.cy]), np.array([self.fx, self.fy])
        return undistort(self.distortion, (np.asarray(corner_px) - 0.5 - middle) / focal)

    def _around_the_axis(self) -> tuple[float, float]:
        x, y = ((np.array([-0.5, n - 0.5]) - c) / f for n, c, f in self._axes)
        if not (x[0] < 0 < x[1] and y[0] < 0 < y[1]):
            raise InputError(
                f"the optical axis, at pixel ({self.cx:g}, {self.cy:g}), is outside of the picture"
                f" of {self.width}×{self.height}"
            )
        along_x = undistort(self.distortion, np.array([[x[0], 0], [x[1], 0]]))[:, 0]
        along_y = undistort(self.distortion, np.array([[0, y[0]], [0, y[1]]]))[:, 1]
        return float(np.abs(along_x).min()), float(np.abs(along_y).min())

    @property
    def aspect(self) -> float:
        """Width over height of rectified pictures."""
        half_width, half_height = self.half_sides
        return half_width / half_height

    @property
    def fovy_deg(self) -> float:
        """Vertical field of view of rectified pictures."""
        return math.degrees(2 * math.atan(self.half_sides[1]))

    def seen_px(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) points of the rectified picture, at unit distance, to where the lens shows them.

        In pixels from the corner of the calibration's pictures.
        """
        seen = distort(self.distortion, self._ahead(points))
        return seen * [self.fx, self.fy] + [self.cx + 0.5, self.cy + 0.5]

    def bent(self, points: np.ndarray, k1: float) -> np.ndarray:
        """(..., 2) points of the rectified picture to where k1 on top of the distortion puts them.

        About the lens's own axis, wherever the rectified picture's middle is.
        """
        seen = distort((k1, 0.0, 0.0, 0.0, 0.0), self._ahead(points))
        back = np.concatenate([seen, np.ones_like(seen[..., :1])], -1)
        back = self.turn.inv().apply(back.reshape(-1, 3)).reshape(back.shape)
        return back[..., :2] / back[..., 2:]

    def _ahead(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) points of the rectified picture to directions before the lens."""
        ahead = np.concatenate([points, np.ones_like(points[..., :1])], -1)
        ahead = self.turn.apply(ahead.reshape(-1, 3)).reshape(ahead.shape)
        return ahead[..., :2] / ahead[..., 2:]

    @property
    def _axes(self) -> tuple[tuple[int, float, float], tuple[int, float, float]]:
        """Pixels, centre and focal length, along x and y."""
        return (self.width, self.cx, self.fx), (self.height, self.cy, self.fy)


def focal_px(height: int, fovy_deg: float | np.ndarray) -> np.ndarray:
    """A pinhole's focal length in pixels, for pictures of this height; of `fovy_deg`'s shape."""
    return height / 2 / np.tan(np.radians(fovy_deg) / 2)


def _times(quaternion: Sequence[float], turn: Rotation) -> list[float]:
    w, x, y, z = quaternion
    x, y, z, w = (Rotation.from_quat([x, y, z, w]) * turn).as_quat().tolist()
    return [w, x, y, z]


def _unit(vector: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return vector / length if length else vector
