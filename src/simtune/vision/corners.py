"""Corners of what moves in pictures: how large it is, and how far a change moves it."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import mujoco
import numpy as np

from simtune.cameras.views import View
from simtune.vision.keypoints import Keypoints, candidate_keypoints

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
