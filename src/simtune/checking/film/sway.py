"""How far what stands still in a film moves: a camera in a hand sways, one on a tripod does not.

Each frame is compared with the episode's median picture, block by block: by least squares, how far
the block is shifted, beside a change of its light. What moves by itself moves some blocks, each its
own way. A camera that sways moves all of them alike. So a film sways if hardly a block stands
still, and most of them go along with each other.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from simtune.cameras.pictures import resize
from simtune.checking.film.camera_film import CameraFilm
from simtune.columns import two_digits
from simtune.vision.smoothing import LUMA

HEIGHT_PX = 64  # to which frames are reduced; shifts are in pixels of that
# Root mean square over an episode's frames. Measured in 8 frames of each of 3 episodes: of a film
# by hand 0.43 to 0.55; of all still ones 0; of those that were shifted by 0.2 to 1, eight tenths of
# that or more where edges are all around, less or nothing where few are, or much moves. Still ones
# are at 0 by `_MAX_OWN_SHARE`. Without it they have: a crane and a plank on a tripod 0.02, a cart
# 0.04, an arm with exposure that drifts by a fifth and a hand in between 0.09, dm_control's scenes
# with shadows 0.10, a robot whose arms fill a third 0.23.
_MIN_SWAY_PX = 0.15
_BLOCK_PX, _BORDER_PX = 8, 2
_COARSE_PX, _FINE_PX = (4.0, 4.0, 2.0, 2.0), 1.0  # smoothing of each step of the search
_MAX_ERROR_PX = 0.1  # of a block's shift along an axis; others show too little there
_NOISE_FACTOR = 2.0  # on a block's noise, which is alike among neighbours: smoothing, compression
_LEAST_NOISE_LEVELS = 0.5  # of 256
_FEWEST_BLOCKS, _LEAST_SPAN = 6, 0.5  # along an axis; and of the width and the height they span
_STILL_QUANTILE = 0.25  # of blocks; fewer than these stand still in a film that sways
_MAX_OWN_SHARE = 0.5  # of the sway: how far half of the blocks may be from where it puts them
_MOST_LEVELS = 40.0  # of a difference: other things count no more than that


def sways(film: CameraFilm) -> dict[str, float]:
    """{episode: by how much it sways, in pixels of HEIGHT_PX}, of those that do clearly."""
    found = zip(film.episodes, map(sway_px, film.frames), strict=False)
    return {episode: px for episode, px in found if px >= _MIN_SWAY_PX}


def sways_in_words(sway: Mapping[str, float], film: CameraFilm) -> str:
    """A warning of a film's `sways`, at least one."""
    worst = max(sway, key=sway.__getitem__)
    much = f"{two_digits(sway[worst])} pixels of {HEIGHT_PX}"
    if own := film.own_px:
        much = f"{two_digits(sway[worst] * own / HEIGHT_PX)} of the film's {own} pixels in height"
    others = [episode for episode in sway if episode != worst]
    also = f", and less in {' and '.join(others)}" if others else ""
    return (
        f"the camera sways: in {worst}, what stands still moves by {much} (root mean square)"
        f"{also} (of {len(film.episodes)} looked at), and the simulator's camera does not: keep it "
        "still, stabilise the film before with software, or leave such episodes out (--leave-out)"
    )


def sway_px(frames: np.ndarray) -> float:
    """Root mean square of how far (K, H, W, 3) uint8 frames are from where they usually are.

    In pixels of HEIGHT_PX. 0 if they stand still, too little is seen, or no sway explains most.
    """
    height, width = frames.shape[1:3]
    size = HEIGHT_PX, max(_BLOCK_PX + 2 * _BORDER_PX, round(width * HEIGHT_PX / height))
    light = np.stack([resize(frame, size) for frame in frames]).astype(np.float32) @ LUMA
    usual = _most_usual(light)
    away = np.zeros((len(frames), 2))
    for smoothing_px in _COARSE_PX:  # beside one frame: the median of many places is a blur
        smooth = _smoothed(light, smoothing_px)
        away = away + _shifts(_back(smooth, away), smooth[usual]).common()
    away = away + _fine(light, away).common()
    return _fine(light, away).sway_px(away)


class _Shifts(NamedTuple):
    """Of each block in each frame: right and down, in pixels."""

    px: np.ndarray  # (K, R, C, 2)
    are_told: np.ndarray  # (R, C, 2) bool, where a block shows enough for that

    def common(self) -> np.ndarray:
        """(K, 2) of most blocks; 0 along an axis of which too few tell."""
        found = np.zeros((len(self.px), 2))
        for axis in (0, 1):
            told = self.are_told[..., axis]
            if told.sum() >= _FEWEST_BLOCKS:
                found[:, axis] = np.median(self.px[:, told, axis], 1)
        return found

    def sway_px(self, before: np.ndarray) -> float:
        """The sway, if frames were shifted back by (K, 2) `before`."""
        return math.hypot(*(self._along(axis, before[:, axis]) for axis in (0, 1)))

    def _along(self, axis: int, before: np.ndarray) -> float:
        told = self.are_told[..., axis]
        if told.sum() < _FEWEST_BLOCKS or _span(told) < _LEAST_SPAN:
            return 0.0
        blocks = _centred(self.px[:, told, axis] + before[:, None])
        common = np.median(blocks, 1, keepdims=True)
        sway = float(np.quantile(_rms(blocks), _STILL_QUANTILE))
        own = float(np.median(_rms(blocks - common)))
        return sway if own < _MAX_OWN_SHARE * sway else 0.0


def _fine(light: np.ndarray, away: np.ndarray) -> _Shifts:
    """Of (K, H, W), shifted back by (K, 2), beside their median."""
    smooth = _back(_smoothed(light, _FINE_PX), away)
    return _shifts(smooth, np.median(smooth, 0), is_fine=True)


def _shifts(smooth: np.ndarray, picture: np.ndarray, *, is_fine: bool = False) -> _Shifts:
    """Of (K, H, W) beside (H, W); `is_fine`: what no shift explains is noise, not a long way."""
    down, right = np.gradient(picture)
    changes = np.stack([-right, -down, picture / 256, np.ones_like(picture)], -1)
    by = _blocks(np.moveaxis(changes, -1, 0))  # (4, R, C, P)
    inverse = np.linalg.inv(np.einsum("ircp,jrcp->rcij", by, by) + 1e-2 * np.eye(4))
    differ = _blocks(smooth - picture)  # (K, R, C, P)
    best = np.einsum("rcij,krcj->krci", inverse, np.einsum("jrcp,krcp->krcj", by, differ))
    noise = np.ones(best.shape[1:3])
    if is_fine:
        rest = differ - np.einsum("ircp,krci->krcp", by, best)
        noise = np.maximum(np.median(_rms(rest, -1), 0), _LEAST_NOISE_LEVELS)
    errors = _NOISE_FACTOR * noise[..., None] * np.sqrt(np.einsum("rcii->rci", inverse)[..., :2])
    return _Shifts(best[..., :2], errors < _MAX_ERROR_PX)


def _blocks(pictures: np.ndarray) -> np.ndarray:
    """(K, R, C, P) of (K, H, W): blocks of P pixels, without a border."""
    inner = pictures[:, _BORDER_PX:-_BORDER_PX, _BORDER_PX:-_BORDER_PX]
    rows, columns = (length // _BLOCK_PX for length in inner.shape[1:])
    whole = inner[:, : rows * _BLOCK_PX, : columns * _BLOCK_PX]
    parted = whole.reshape(-1, rows, _BLOCK_PX, columns, _BLOCK_PX).swapaxes(2, 3)
    return parted.reshape(*parted.shape[:3], -1)


def _most_usual(light: np.ndarray) -> int:
    """Which of (K, H, W) is most like the others."""
    return int(np.argmin([np.minimum(abs(light - one), _MOST_LEVELS).mean() for one in light]))


def _back(smooth: np.ndarray, away: np.ndarray) -> np.ndarray:
    """(K, H, W) frames, each shifted back from (K, 2) right and down."""
    pairs = zip(smooth, away, strict=True)
    return np.stack([shift(one, -px[::-1], order=1, mode="nearest") for one, px in pairs])


def _smoothed(light: np.ndarray, pixels: float) -> np.ndarray:
    return gaussian_filter(light, (0, pixels, pixels))


def _span(told: np.ndarray) -> float:
    """The smaller share of (R, C) rows or columns from the first to the last told of."""
    return min(
        float(np.ptp(at) + 1) / num for at, num in zip(told.nonzero(), told.shape, strict=True)
    )


def _centred(blocks: np.ndarray) -> np.ndarray:
    return blocks - np.median(blocks, 0)


def _rms(values: np.ndarray, axis: int = 0) -> np.ndarray:
    return np.sqrt((values**2).mean(axis))
