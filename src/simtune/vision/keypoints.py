"""Keypoints: points on geoms that move relative to a camera, where they appear in the picture.

A single picture shows where things are, and in simulation this is known for free. So the encoder is
first trained on the picture coordinates of a few points that together determine all others, for any
model with a camera, without naming a joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.cameras.lens import focal_px
from simtune.cameras.pictures import BORDER_PX
from simtune.cameras.views import View
from simtune.parameters.model_writer import start_from_material
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.simulation import AnySimulator, EnvironmentSimulator, Points, Simulator
from simtune.simulation.rendering.appearance import NUM_GROUPS
from simtune.simulation.rendering.plate import stands_still

# As values: see `parameters.joint_types`
_SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE.value  # its ends add nothing to its centre
_ROUND_GEOMS = (mujoco.mjtGeom.mjGEOM_CAPSULE.value, mujoco.mjtGeom.mjGEOM_CYLINDER.value)
_MOUNTED = mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value
ENDLESS = (mujoco.mjtGeom.mjGEOM_PLANE.value, mujoco.mjtGeom.mjGEOM_HFIELD.value)
_THREE_SIZES = (mujoco.mjtGeom.mjGEOM_BOX.value, mujoco.mjtGeom.mjGEOM_ELLIPSOID.value)
PILOT_STEPS = 3200  # simulated to choose keypoints
_NUM_PILOTS = 32
_MAX_KEYPOINTS = 16  # of a view
_TOLERANCE_PX = 0.3  # root mean square of what the chosen keypoints do not explain


@dataclass(frozen=True)
class Keypoints:
    """L points fixed to geoms, each as seen in one of the views that a picture consists of."""

    geoms: np.ndarray  # (L,) geom ids
    offsets: np.ndarray  # (L, 3) in the geom's frame, m
    views: np.ndarray  # (L,) index of the view
    cameras: np.ndarray  # (views,) camera ids
    widths: np.ndarray  # (views,) pixels
    height: int  # pixels, of all views

    @classmethod
    def none(cls) -> "Keypoints":
        """Without a camera."""
        nothing = np.zeros(0, int)
        return cls(nothing, np.zeros((0, 3)), nothing, nothing, nothing, 1)

    def __len__(self) -> int:
        return len(self.geoms)

    def observe(self, batch: Batch) -> np.ndarray:
        """(nsim, L · 2) float32 pixel coordinates x, y, with 0 at the first pixel's centre."""
        points = self.positions(batch)
        pixels = np.empty((batch.nsim, len(self), 2), np.float32)
        lefts = np.cumsum(self.widths) - self.widths
        for view, (camera, width, left) in enumerate(
            zip(self.cameras, self.widths, lefts, strict=True)
        ):
            mine = self.views == view
            turn = batch.cam_xmat.reshape(batch.nsim, -1, 3, 3)[:, camera]
            away = points[:, mine] - batch.cam_xpos[:, None, camera]
            seen = np.einsum("nli,nij->nlj", away, turn)
            focal = focal_px(self.height, batch.camera(int(camera)).fovy.reshape(batch.nsim))
            pixels[:, mine] = _project(seen, focal, int(width), self.height)
            pixels[:, mine, 0] += left
        return pixels.reshape(batch.nsim, -1)

    def positions(self, batch: Batch) -> np.ndarray:
        """(nsim, L, 3) in the world, m."""
        rotation = batch.geom_xmat.reshape(batch.nsim, -1, 3, 3)[:, self.geoms]
        return batch.geom_xpos[:, self.geoms] + np.einsum("nlij,lj->nli", rotation, self.offsets)

    def select(self, indices: list[int]) -> "Keypoints":
        geoms, offsets, views = self.geoms[indices], self.offsets[indices], self.views[indices]
        return replace(self, geoms=geoms, offsets=offsets, views=views)

    def state(self) -> list:
        """JSON, to restore the same choice."""
        return [self.geoms.tolist(), self.offsets.tolist(), self.views.tolist()]

    def with_state(self, state: list) -> "Keypoints":
        geoms, views = (np.array(indices, int) for indices in (state[0], state[2]))
        offsets = np.array(state[1], float).reshape(-1, 3)
        return replace(self, geoms=geoms, offsets=offsets, views=views)


def _project(seen: np.ndarray, focal_length_px: np.ndarray, width: int, height: int) -> np.ndarray:
    """(n, L, 3) points in the camera's frame (it looks along −z) to (n, L, 2) pixels."""
    depth = np.maximum(-seen[..., 2:], 1e-3)
    direction = seen[..., :2] / depth * [1, -1]
    last = np.array([width, height]) - 1
    pixels = last / 2 + focal_length_px[:, None, None] * direction
    return np.clip(pixels, BORDER_PX, last - BORDER_PX).astype(np.float32)


def candidate_keypoints(model: mujoco.MjModel, seen: Sequence[View], height: int) -> Keypoints:
    """The centre and, where it has some, the two ends of every geom that moves before a camera.

    Only of geoms that are drawn: nothing shows where others are. For each view in turn, in pictures
    with a height of `height` pixels.
    """
    cameras = np.array([model.camera(view.camera).id for view in seen], int)
    geoms, offsets, views = [], [], []
    for view, camera in enumerate(cameras):
        shown = is_drawn(model) & moves_before(model, camera)
        if seen[view].background_is_unknown:  # what stands still in the world is not drawn
            shown &= ~stands_still(model)
        for geom in np.flatnonzero(shown).tolist():
            ends = [0.0] if model.geom_type[geom] == _SPHERE else [-1.0, 0.0, 1.0]
            half_length = _half_length(model, geom)
            for end in ends:
                geoms.append(geom)
                offsets.append([0.0, 0.0, end * half_length])
                views.append(view)
    return Keypoints(
        np.array(geoms, int),
        np.array(offsets).reshape(-1, 3),
        np.array(views, int),
        cameras,
        np.array([view.width(height) for view in seen], int),
        height,
    )


def is_drawn(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) bool: geoms that cameras show, not only used for contacts."""
    rgba = model.geom_rgba.copy()
    start_from_material(rgba, np.arange(model.ngeom), model, "geom_rgba")
    return (model.geom_group < NUM_GROUPS) & (rgba[:, 3] > 0)


def moves_before(model: mujoco.MjModel, camera: int) -> np.ndarray:
    """(ngeom,) bool: geoms that can move in the picture; before a robot's camera, all but its own.

    A camera that merely tracks a body does not turn with it.
    """
    fixed_to, is_mounted = model.body_weldid[model.geom_bodyid], model.cam_mode[camera] == _MOUNTED
    own = model.body_weldid[model.cam_bodyid[camera]] if is_mounted else 0
    endless = np.isin(model.geom_type, ENDLESS)  # planes have no visible centre
    return (fixed_to != own) & ~((fixed_to == 0) & endless)


def _half_length(model: mujoco.MjModel, geom: int) -> float:
    """Extent along the geom's z axis, m."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind in _ROUND_GEOMS:
        return float(size[1])
    if kind in _THREE_SIZES:
        return float(size[2])
    return float(model.geom_aabb[geom, 5])  # meshes and the rest: the bounding box


def choose_keypoints(seen: np.ndarray) -> list[int]:
    """The few keypoints from which all others follow linearly.

    `seen`: (samples, L, 2) pixels. Greedy: the next one is always the least explained by those
    chosen, until every unexplained rest is below `_TOLERANCE_PX` (root mean square).
    """
    rest = (seen - seen.mean(0)).astype(float)  # (samples, L, 2)
    chosen: list[int] = []
    while len(chosen) < min(_MAX_KEYPOINTS, seen.shape[1]):
        unexplained = np.sqrt((rest**2).mean(0).sum(-1))  # (L,)
        best = int(unexplained.argmax())
        if unexplained[best] < _TOLERANCE_PX:
            break
        chosen.append(best)
        basis, _ = np.linalg.qr(rest[:, best])  # (samples, 2)
        rest = rest - np.einsum("sb,blc->slc", basis, np.einsum("sb,slc->blc", basis, rest))
    return chosen


def every_keypoint(simulator: AnySimulator) -> Keypoints | Points:
    """All keypoints of a simulator, without simulating."""
    if isinstance(simulator, Simulator):
        return candidate_keypoints(simulator.model, simulator.views, simulator.image_size)
    assert isinstance(simulator, EnvironmentSimulator)
    return simulator.points()


def find_keypoints(
    simulator: AnySimulator,
    distribution: Distribution,
    seed: int,
    points: Keypoints | Points | None = None,
) -> Keypoints | Points:
    """Few of `points` (by default of all) from which the others follow, told by a few episodes.

    These explore worlds of the `distribution`. Keypoints are chosen for each view separately: what
    two cameras see is measured twice. Raises RuntimeError if no world of a model stays finite.
    """
    rng = stream(seed, Purpose.KEYPOINTS)
    points = every_keypoint(simulator) if points is None else points
    if not len(points):
        return points
    steps = PILOT_STEPS // _NUM_PILOTS
    act = simulator.explore(_NUM_PILOTS, steps, rng)
    parameters = distribution.sample(_NUM_PILOTS, rng)
    played = simulator.play(parameters, act, steps, rng, observe=points.observe)
    finished = played.finished()
    if not len(finished):
        if isinstance(simulator, Simulator):
            raise RuntimeError(
                f"each of {_NUM_PILOTS} worlds with random actions diverged within {steps} steps, "
                "so nothing tells which points move; check the timestep, the bounds and where "
                "episodes begin"
            )
        finished = played  # an environment's points stay where its episodes end
    seen = finished.observed.reshape(-1, len(points), 2)
    of_view = points.views if isinstance(points, Keypoints) else np.zeros(len(points), int)
    chosen: list[int] = []
    for view in np.unique(of_view):
        mine = np.flatnonzero(of_view == view)
        chosen += mine[choose_keypoints(seen[:, mine])].tolist()
    return points.select(chosen)
