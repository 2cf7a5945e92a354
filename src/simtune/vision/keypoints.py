"""Keypoints: points on moving geoms, where they appear in the picture.

In simulation the true state is free. What a single picture can show of it is where things
are, so that is what the encoder is taught first: the picture coordinates of a few points that
together fix all others, for any model with a camera and without naming a joint.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.randomization import Distribution
from simtune.simulation import AnySimulator, EnvironmentSimulator, Points, Simulator

# Values, since MuJoCo's enums are unequal to the integers in its arrays.
_SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE.value  # its ends tell nothing that its centre does not
_ROUND = (mujoco.mjtGeom.mjGEOM_CAPSULE.value, mujoco.mjtGeom.mjGEOM_CYLINDER.value)
_THREE_SIZES = (mujoco.mjtGeom.mjGEOM_BOX.value, mujoco.mjtGeom.mjGEOM_ELLIPSOID.value)
PILOT_STEPS = 3200  # simulated to choose keypoints by
_PILOTS = 32
_MARGIN_PX = 1.0  # a point outside the picture is taken to be this far beyond its edge


@dataclass(frozen=True)
class Keypoints:
    """L points fixed to geoms, as one camera with a picture of `image_size` pixels sees them."""

    geoms: np.ndarray  # (L,) geom ids
    offsets: np.ndarray  # (L, 3) in the geom's frame, m
    camera: int
    image_size: int

    @classmethod
    def none(cls) -> "Keypoints":
        """Where no camera films."""
        return cls(np.zeros(0, int), np.zeros((0, 3)), 0, 1)

    def __len__(self) -> int:
        return len(self.geoms)

    def observe(self, batch: Batch) -> np.ndarray:
        """(nsim, L · 2) float32 pixel coordinates x, y, with 0 at the first pixel's centre."""
        rotation = batch.geom_xmat.reshape(batch.nsim, -1, 3, 3)[:, self.geoms]
        points = batch.geom_xpos[:, self.geoms] + np.einsum("nlij,lj->nli", rotation, self.offsets)
        camera_rotation = batch.cam_xmat.reshape(batch.nsim, -1, 3, 3)[:, self.camera]
        seen = np.einsum(
            "nli,nij->nlj", points - batch.cam_xpos[:, None, self.camera], camera_rotation
        )
        return self._project(seen, self._focal_length_px(batch)).reshape(batch.nsim, -1)

    def _focal_length_px(self, batch: Batch) -> np.ndarray:
        fovy = batch.camera(self.camera).fovy.reshape(batch.nsim)
        return self.image_size / 2 / np.tan(np.radians(fovy) / 2)

    def _project(self, seen: np.ndarray, focal_length_px: np.ndarray) -> np.ndarray:
        """(n, L, 3) points in the camera's frame (it looks along −z) to (n, L, 2) pixels."""
        depth = np.maximum(-seen[..., 2:], 1e-3)
        direction = seen[..., :2] / depth * [1, -1]
        middle = (self.image_size - 1) / 2
        pixels = middle + focal_length_px[:, None, None] * direction
        edge = _MARGIN_PX
        return np.clip(pixels, -edge, self.image_size - 1 + edge).astype(np.float32)

    def select(self, indices: list[int]) -> "Keypoints":
        return replace(self, geoms=self.geoms[indices], offsets=self.offsets[indices])

    def state(self) -> list:
        """JSON to choose the same again by."""
        return [self.geoms.tolist(), self.offsets.tolist()]

    def with_state(self, state: list) -> "Keypoints":
        geoms, offsets = np.array(state[0], int), np.array(state[1], float)
        return replace(self, geoms=geoms, offsets=offsets.reshape(-1, 3))


def candidate_keypoints(model: mujoco.MjModel, camera: str, image_size: int) -> Keypoints:
    """The centre and, where it has some, the two ends of every geom that can move."""
    geoms, offsets = [], []
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] == 0:
            continue
        ends = [0.0] if model.geom_type[geom] == _SPHERE else [-1.0, 0.0, 1.0]
        half_length = _half_length(model, geom)
        for end in ends:
            geoms.append(geom)
            offsets.append([0.0, 0.0, end * half_length])
    index = model.camera(camera).id
    return Keypoints(np.array(geoms, int), np.array(offsets).reshape(-1, 3), index, image_size)


def _half_length(model: mujoco.MjModel, geom: int) -> float:
    """Extent along the geom's z axis, m."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind in _ROUND:
        return float(size[1])
    if kind in _THREE_SIZES:
        return float(size[2])
    return float(model.geom_aabb[geom, 5])  # meshes and the rest: the bounding box


def choose_keypoints(seen: np.ndarray, at_most: int = 16, tolerance_px: float = 0.3) -> list[int]:
    """The few keypoints from which all others follow linearly.

    `seen`: (samples, L, 2) pixels. Greedy: each next one is the least explained by those
    before, until what is unexplained of every one is below `tolerance_px` (root mean square).
    """
    rest = (seen - seen.mean(0)).astype(float)  # (samples, L, 2)
    chosen: list[int] = []
    while len(chosen) < min(at_most, seen.shape[1]):
        unexplained = np.sqrt((rest**2).mean(0).sum(-1))  # (L,)
        best = int(unexplained.argmax())
        if unexplained[best] < tolerance_px:
            break
        chosen.append(best)
        basis, _ = np.linalg.qr(rest[:, best])  # (samples, 2)
        rest = rest - np.einsum("sb,blc->slc", basis, np.einsum("sb,slc->blc", basis, rest))
    return chosen


def every_keypoint(simulator: AnySimulator, camera: str) -> Keypoints | Points:
    """All that a simulator has; nothing is simulated."""
    if isinstance(simulator, Simulator):
        return candidate_keypoints(simulator.model, camera, simulator.image_size)
    assert isinstance(simulator, EnvironmentSimulator)
    return simulator.points()


def find_keypoints(
    simulator: AnySimulator, camera: str, distribution: Distribution, seed: int
) -> Keypoints | Points:
    """Few keypoints from which all others follow, judged by a few exploring episodes."""
    rng, every = np.random.default_rng(seed), every_keypoint(simulator, camera)
    if not len(every):
        return every
    steps = PILOT_STEPS // _PILOTS
    act, parameters = simulator.explore(_PILOTS, steps, rng), distribution.sample(_PILOTS, rng)
    rollouts = simulator.play(parameters, act, steps, rng, observe=every.observe).finished()
    return every.select(choose_keypoints(rollouts.observed.reshape(-1, len(every), 2)))
