"""The robot in measured states: its outlines before a camera, and points on it."""

from typing import NamedTuple

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

from simtune.camera_pose.geometry import CameraGeometry, Pose
from simtune.camera_pose.scene import has_outlines, robot_before
from simtune.errors import InputError
from simtune.simulation.rendering.depths import Depths

_MESH = mujoco.mjtGeom.mjGEOM_MESH.value
_POINTS_PER_GEOM = 4
_HIDDEN_POSITION_M = 1e4  # of geoms that are not to be seen
_OUTLINE_DEPTH_STEP = 0.04  # relative, that makes an outline
_SIGMA_PX = 1.2  # for an outline's direction
_SAME_PLACE_PX = 3  # side of the square that counts as the same place
_MARGIN_PX = 2.0  # of the picture, where outlines are cut off


class Outlines(NamedTuple):
    """N points on edges: the robot's boundary, jumps in distance, or seams between parts."""

    frames: np.ndarray  # (N,) index of the state
    points: np.ndarray  # (N, 3) m, in the frame of the body that the camera is fixed to
    normals: np.ndarray  # (N, 2) in the picture, into the robot
    pixels: np.ndarray  # (N, 2) of the film
    still: np.ndarray  # (N,) share of the other frames with an edge of the robot at the same place


class Robot:
    """All that moves before the camera, in M states."""

    def __init__(
        self,
        model: mujoco.MjModel,
        camera: str,
        states: np.ndarray,
        geometry: CameraGeometry,
        hidden: np.ndarray,
    ):
        """(M, S) full states; `geometry`: of the film's pictures; `hidden`: (ngeom,) bool, left
        out since they may be anywhere. Raises InputError if nothing else moves.
        """
        self._model, self._geometry, self._hidden = model, geometry, hidden
        self._moves = robot_before(model, camera) & ~hidden
        if not self._moves.any():
            raise InputError(f"nothing that sensors measure moves before camera {camera!r}")
        given = model.camera(camera)
        self._poses = [_poses(model, int(given.bodyid[0]), state) for state in states]
        shown = has_outlines(model)
        self._depths = [Depths(model, camera, _smaller(geometry.size, by), shown) for by in (1, 2)]

    def outlines(
        self, unit: np.ndarray, which: np.ndarray, at_most: int, is_rough: bool = False
    ) -> Outlines:
        """Before a camera (P,), in some of the states; `is_rough`: drawn half as large.

        A point lies between two pixels of a drawing, at the distance of the nearer one.
        """
        drawing = self._depths[is_rough]
        geoms, near = self._draw(drawing, self._geometry.pose(unit), which)
        is_robot = near[:-1] > near[-1]
        near, parts = np.maximum(near[:-1], near[-1]), np.where(is_robot, geoms[:-1], -1)
        shades = np.append(np.random.default_rng(0).permutation(self._model.ngeom), 0.0)[parts]
        slopes = [_uphill(pictures) for pictures in (near, shades)]
        found = [_steps(near, parts, slopes, axis) for axis in (1, 2)]
        frames, pixels, nearness, normals = map(np.concatenate, zip(*found, strict=True))
        size = np.array(drawing.size[::-1])
        still = _standing(frames, pixels, near.shape)
        inside = (pixels >= _MARGIN_PX).all(1) & (pixels <= size - 1 - _MARGIN_PX).all(1)
        inside &= (normals**2).sum(1) > 0
        chosen = np.flatnonzero(inside)
        chosen = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), at_most)).astype(int)]
        pixels = (pixels[chosen] + 0.5) * (np.array(self._geometry.size[::-1]) / size) - 0.5
        normals = normals[chosen] / np.linalg.norm(normals[chosen], axis=1, keepdims=True)
        points = self._geometry.lift(unit, pixels, 1 / nearness[chosen])
        return Outlines(frames[chosen], points, normals, pixels, still[chosen])

    def surface_points(self, which: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(K, L, 3) on drawn surfaces: vertices of meshes, or points in bounding boxes."""
        geoms = np.flatnonzero(self._moves).tolist()
        offsets = np.stack([_surface(self._model, geom, rng) for geom in geoms])  # (G, each, 3)
        found = []
        for places, turns, body_place, body_turn in (self._poses[k] for k in which):
            points = np.einsum("gij,gkj->gki", turns[geoms], offsets) + places[geoms, None]
            found.append((points.reshape(-1, 3) - body_place) @ body_turn)
        return np.stack(found)

    def _draw(
        self, drawing: Depths, pose: Pose, which: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(K + 1, H, W) geoms and 1/m: the robot alone in K states, then the background alone."""
        places, turns, body_places, body_turns = (
            np.stack(values)
            for values in zip(*(self._poses[k] for k in [*which, which[0]]), strict=True)
        )
        places[:-1, ~self._moves] = places[-1:, self._moves] = _HIDDEN_POSITION_M
        places[:, self._hidden] = _HIDDEN_POSITION_M
        geoms, depths = drawing.draw(
            places,
            turns,
            body_places + body_turns @ pose.place,
            body_turns @ pose.turn,
            pose.fovy_deg,
        )
        return geoms, np.where(depths > 0, 1 / np.maximum(depths, 1e-3), 0)


def _poses(model: mujoco.MjModel, body: int, state: np.ndarray) -> tuple[np.ndarray, ...]:
    """Positions and rotations of all geoms, and of the body that the camera is fixed to."""
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_kinematics(model, data)
    turns = data.geom_xmat.reshape(-1, 3, 3).copy()
    return data.geom_xpos.copy(), turns, data.xpos[body].copy(), data.xmat[body].reshape(3, 3)


def _smaller(size: tuple[int, int], by: int) -> tuple[int, int]:
    return max(1, size[0] // by), max(1, size[1] // by)


def _uphill(pictures: np.ndarray) -> np.ndarray:
    """(M, H, W, 2) to the right, and down."""
    smooth = gaussian_filter(pictures.astype(np.float32), (0, _SIGMA_PX, _SIGMA_PX))
    return np.stack([np.gradient(smooth, axis=axis) for axis in (2, 1)], -1)


def _steps(
    near: np.ndarray, parts: np.ndarray, slopes: list[np.ndarray], axis: int
) -> tuple[np.ndarray, ...]:
    """Frames, places, nearness and normals of edges between neighbours along an axis."""
    last = near.shape[axis] - 1
    first, second = ((slice(None),) * axis + (part,) for part in (slice(last), slice(1, None)))
    one, other = near[first], near[second]
    nearer = np.maximum(one, other)
    ends = np.where(one > other, parts[first], parts[second]) >= 0
    ends &= np.abs(one - other) > _OUTLINE_DEPTH_STEP * nearer
    seams = (parts[first] >= 0) & (parts[second] >= 0) & (parts[first] != parts[second]) & ~ends
    frame, row, column = at = np.nonzero(ends | seams)
    places = np.stack([column, row], 1) + 0.5 * np.array([axis == 2, axis == 1])
    normals = [(slope[first] + slope[second])[at] for slope in slopes]
    return frame, places, nearer[at], np.where(ends[at][:, None], *normals)


def _standing(frames: np.ndarray, pixels: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(N,) shares of other frames with such points at the same or a neighbouring place."""
    there = np.zeros(shape, np.uint8)
    column, row = pixels.astype(int).T
    there[frames, row, column] = 1
    often = maximum_filter(there, (1, _SAME_PLACE_PX, _SAME_PLACE_PX)).sum(0)
    return (often[row, column] - 1) / max(1, shape[0] - 1)


def _surface(model: mujoco.MjModel, geom: int, rng: np.random.Generator) -> np.ndarray:
    """(4, 3) in the geom's frame."""
    mesh = model.geom_dataid[geom] if model.geom_type[geom] == _MESH else -1
    if mesh >= 0:
        first, num = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        return model.mesh_vert[first + rng.integers(num, size=_POINTS_PER_GEOM)]
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    return middle + half * rng.uniform(-0.9, 0.9, (_POINTS_PER_GEOM, 3))
