"""How large what moves is in pictures: a few pixels tell a detector little."""

import math
from dataclasses import replace
from itertools import product

import numpy as np

from simtune.simulation import Simulator
from simtune.vision.keypoints import Keypoints, candidate_keypoints, is_drawn

_STEPS, _EPISODES = 12, 4  # that are looked at, at most
_FEW_PX, _ENOUGH_PX = 3.5, 5.0  # across: what is found within .2 pixels or so is known to 5 %
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))  # of a box


def extents_px(simulator: Simulator, states: np.ndarray) -> dict[str, float]:
    """{body: pixels} across what moves, where it is narrow, as the camera that shows most sees it.

    In the median over some of the (E, T + 1, S) states of nominal worlds.
    """
    corners = _corners(simulator)
    if not len(corners):
        return {}
    at = np.linspace(0, states.shape[1] - 1, min(_STEPS, states.shape[1])).astype(int)
    some = states[:_EPISODES, at].reshape(-1, states.shape[2])
    worlds = np.tile(simulator.space.nominal, (len(some), 1))
    still, rng = np.zeros((len(some), 0, simulator.num_actions)), np.random.default_rng(0)
    seen = simulator.roll_out(worlds, still, rng, corners.observe, starts=some).observed
    pixels = seen.reshape(-1, len(corners), 2).astype(float)
    model = simulator.model
    bodies = model.body_weldid[model.geom_bodyid[corners.geoms]]
    found: dict[str, float] = {}
    for body, view in sorted(set(zip(bodies.tolist(), corners.views.tolist(), strict=True))):
        its = pixels[:, (bodies == body) & (corners.views == view)]
        name = model.body(body).name or f"body {body}"
        found[name] = max(found.get(name, 0.0), float(np.median(_across(its))))
    return found


def small(extents: dict[str, float], image_size: int) -> list[str]:
    """A warning where even the largest of what moves is small."""
    if not extents or max(extents.values()) >= _FEW_PX:
        return []
    name = max(extents, key=lambda its: extents[its])
    larger = 8 * math.ceil(_ENOUGH_PX / max(extents[name], 0.1) * image_size / 8)
    return [
        f"what moves is small: the largest, {name}, is {extents[name]:.1f} of {image_size} pixels "
        f"across. --image-size {larger} would show {_ENOUGH_PX:g}, if the recordings have as many; "
        "or look at a region of them alone, [camera] region = ..."
    ]


def _corners(simulator: Simulator) -> Keypoints:
    """Of the bounding boxes of all geoms that move before a camera."""
    model = simulator.model
    every = candidate_keypoints(model, simulator.views, simulator.image_size)
    pairs = np.unique(np.stack([every.views, every.geoms], 1), axis=0)
    pairs = pairs[is_drawn(model)[pairs[:, 1]]]
    views, geoms = np.repeat(pairs, len(_CORNERS), 0).T
    middle, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    offsets = middle + half * np.tile(_CORNERS, (len(pairs), 1))
    return replace(every, geoms=geoms, offsets=offsets, views=views)


def _across(pixels: np.ndarray) -> np.ndarray:
    """(n,) how far (n, L, 2) points reach along the axis along which they reach least."""
    away = pixels - pixels.mean(1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nli,nlj->nij", away, away))
    return np.ptp(np.einsum("nli,ni->nl", away, axes[:, :, 0]), axis=1)
