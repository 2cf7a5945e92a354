"""Corners of what moves in pictures: how large it is, and how far a change moves it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.cameras.views import View
from simtune.simulation.rendering.appearance import NUM_GROUPS
from simtune.vision.keypoints import Keypoints, candidate_keypoints

_FLEX = mujoco.mjtObj.mjOBJ_FLEX.value
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))  # of a box


def corners_of_parts(model: mujoco.MjModel, views: Sequence[View], height: int) -> Keypoints:
    """Corners of the bounding boxes of all drawn geoms that move before a camera.

    As seen in pictures with a height of `height` pixels.
    """
    candidates = candidate_keypoints(model, views, height)
    pairs = np.unique(np.stack([candidates.views, candidates.geoms], 1), axis=0)
    views, geoms = np.repeat(pairs, len(_CORNERS), 0).T
    middle, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    offsets = middle + half * np.tile(_CORNERS, (len(pairs), 1))
    return replace(candidates, geoms=geoms, offsets=offsets, views=views)


@dataclass(frozen=True)
class FlexVertices(Keypoints):
    """Vertices of flexes, as seen in each view: `geoms` are the vertices' ids."""

    def positions(self, batch: Batch) -> np.ndarray:
        """(nsim, L, 3) in the world, m."""
        return batch.flexvert_xpos.reshape(batch.nsim, -1, 3)[:, self.geoms]


def vertices_of_flexes(
    model: mujoco.MjModel, views: Sequence[View], height: int
) -> dict[str, FlexVertices]:
    """{name: the vertices of each flex that is drawn}."""
    found = {}
    cameras = np.array([model.camera(view.camera).id for view in views], int)
    widths = np.array([view.width(height) for view in views], int)
    is_shown = (model.flex_group < NUM_GROUPS) & (model.flex_rgba[:, 3] > 0)
    for flex in np.flatnonzero(is_shown).tolist():
        vertices = model.flex_vertadr[flex] + np.arange(model.flex_vertnum[flex])
        ids = np.tile(vertices, len(views))
        seen_in = np.repeat(np.arange(len(views)), len(vertices))
        offsets = np.zeros((len(ids), 3))
        name = mujoco.mj_id2name(model, _FLEX, flex) or f"flex {flex}"
        found[name] = FlexVertices(ids, offsets, seen_in, cameras, widths, height)
    return found
