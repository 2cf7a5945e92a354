"""Pictures drawn for a fit: with other parameters, slightly other states, by real cameras."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion, generate_binary_structure

from simtune.cameras.views import apart, parts
from simtune.fit.pictures.response import NUM_UNKNOWN, CameraResponse
from simtune.simulation import Simulator
from simtune.vision.smoothing import smoothed, with_smooth_chroma

SHOWN = 0.05  # change of a pixel, of the full scale, over a parameter's whole range
_DELTA = 0.03  # finite-difference step of a parameter: several of a pixel's 256 levels
_WHITE = 254.5 / 255
_MARGIN_PX = 1
_LARGEST_MOVE = 4.0  # of a pose, in standard deviations
# By how many smoothings a lens blurs pictures at most, and a video their chroma: about 1 for one of
# pixels that are not averaged afterwards.
_MAX_SMOOTHINGS = 1.0, 2.0


class PixelSlopes(NamedTuple):
    """Derivatives of pixels, of the full scale."""

    shown: np.ndarray  # (V, M, pixels) by each parameter's unit coordinate
    blur: np.ndarray  # (2 C, M, pixels) by each camera's `PictureScene.blur`
    response: np.ndarray  # (5 C, M, pixels) by each unknown of the cameras' responses
    pose: np.ndarray  # (D, M, pixels) by each standard deviation of a pose

    @classmethod
    def none(cls, num: int) -> "PixelSlopes":
        nothing = np.zeros((0, num, 0), np.float32)
        return cls(nothing, nothing, nothing, nothing)


class PictureScene:
    """M pictures of the C cameras of a simulator."""

    def __init__(
        self,
        simulator: Simulator,
        full_states: np.ndarray,
        shown: np.ndarray,
        poses: np.ndarray | None,
        is_real: bool,
        parameters: np.ndarray,
    ):
        """`shown`: (V,) indices of the visible parameters; `poses`: see `Pictures`.

        `parameters`: (N,) by which pictures show anything but an unknown background.

        `is_real`: the cameras have responses, initially the identity, and their colours come from
        compressed videos.
        """
        self._simulator, self._full_states, self._shown = simulator, full_states, shown
        self._space, self._is_real = simulator.state_space, is_real
        shape = (len(full_states), 0, self._space.num_tangent)
        self._poses = np.zeros(shape) if poses is None else poses
        self.moved = np.zeros(self._poses.shape[:2])  # (M, D) in standard deviations
        covered = simulator.covers(full_states, np.tile(parameters, (len(full_states), 1)))
        self._is_known = _within(covered)[..., None]  # (M, H, W, 1) bool
        num_real = len(simulator.widths) * is_real
        # (M, C) logarithms of the pictures' exposures, 0 on average over those of a camera
        self.log_exposure = np.zeros((len(full_states), num_real))
        self.response = np.zeros(NUM_UNKNOWN * num_real)  # (5 C,)
        self.blur = np.zeros(2 * num_real)  # (2 C,) of what it may be at most, see `blurs`
        self._rendered = np.zeros((0, 0, 0, 3), np.float32)  # by the last `draw`

    @property
    def responses(self) -> list[CameraResponse]:
        """One per camera; none if pictures are the simulator's own."""
        return [CameraResponse(unknown) for unknown in self.response.reshape(-1, NUM_UNKNOWN)]

    @property
    def blurs(self) -> np.ndarray:
        """(C, 2) smoothing of each camera's pictures by its lens, and of their chroma by its video.

        float32; 1: as much as smoothing once.
        """
        return (self.blur.reshape(-1, 2) * _MAX_SMOOTHINGS).astype(np.float32)

    def move(self, change: np.ndarray) -> None:
        """Move the poses by (M, D)."""
        self.moved = np.clip(self.moved + change, -_LARGEST_MOVE, _LARGEST_MOVE)

    def compared(self, pictures: np.ndarray) -> np.ndarray:
        """(..., pixels) of (..., M, H, W, 3); of a real camera without fine chroma.

        0 where an unknown background shows, in all pictures.
        """
        if self._is_real:
            views = apart(pictures, self._simulator.widths)
            pictures = np.concatenate([with_smooth_chroma(view) for view in views], -2)
        return (pictures * self._is_known).reshape(*pictures.shape[:-3], -1)

    def draw(self, unit: np.ndarray) -> np.ndarray:
        """(M, pixels) as seen with (N,) parameters."""
        self._rendered = self._render(self.moved, unit)
        return self._see(self._rendered)

    def is_overexposed(self, frames: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """(M, pixels) bool: saturated both in (M, H, W, 3) frames and in what was drawn last.

        Nothing shows how much brighter such a pixel would be, so it must not hold back a colour
        that other pixels make brighter. `noise`: (M, pixels). Both are of the full scale.
        """
        num = len(frames)
        white = self._respond(np.full(frames.shape, _WHITE, np.float32))
        is_white = (self._rendered >= _WHITE).reshape(num, -1)
        return is_white & (frames.reshape(num, -1) >= white.reshape(num, -1) - noise)

    def derive(self, unit: np.ndarray, drawn: np.ndarray) -> PixelSlopes:
        """Derivatives at the (M, pixels) that `draw` drew last, with (N,) parameters."""
        slopes = np.empty((len(self._shown), *drawn.shape), np.float32)
        for i, shown in enumerate(self._shown):
            # Darker, if there is room: anything brighter than white looks the same.
            units, delta = unit.copy(), _DELTA if unit[shown] < _DELTA else -_DELTA
            units[shown] += delta
            slopes[i] = (self._see(self._render(self.moved, units)) - drawn) / delta
        of_pose = np.empty((self.moved.shape[1], *drawn.shape), np.float32)
        for i, one in enumerate(np.eye(self.moved.shape[1])):
            of_pose[i] = self._see(self._render(self.moved + one, unit)) - drawn
        of_blur, of_response = self._derive_cameras(drawn)
        # Only where a fitted parameter shows: other colours of the model may be wrong.
        of_blur *= (np.abs(slopes) > SHOWN).any(0)
        return PixelSlopes(slopes, of_blur, of_response, of_pose)

    def _derive_cameras(self, like: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(2 C, M, pixels) and (5 C, M, pixels) derivatives; none if no camera is real."""
        if not self._is_real:
            nothing = np.zeros((0, *like.shape), np.float32)
            return nothing, nothing
        rendered, exposures = self._rendered, np.exp(self.log_exposure)
        of_blur = np.zeros((len(self.blur), *rendered.shape), np.float32)
        slopes = np.zeros((len(self.response), *rendered.shape), np.float32)
        cameras = zip(self.responses, exposures.T, parts(self._simulator.widths), strict=True)
        for number, (response, exposure, columns) in enumerate(cameras):
            view, from_here = rendered[:, :, columns], slice(NUM_UNKNOWN * number, None)
            slopes[from_here][:NUM_UNKNOWN, :, :, columns] = response.derive(view, exposure)
            sharp, (soft, chroma) = response(view, exposure), self.blurs[number]
            (most_soft, most_chroma), of_own = _MAX_SMOOTHINGS, of_blur[2 * number :]
            lost = _lost_sharpness(sharp)
            of_own[0, ..., columns, :] = most_soft * (lost + chroma * _lost_chroma(lost))
            of_own[1, ..., columns, :] = most_chroma * _lost_chroma(sharp + soft * lost)
        return self.compared(of_blur), self.compared(slopes)

    def _see(self, rendered: np.ndarray) -> np.ndarray:
        """(M, pixels) of (M, H, W, 3), with the cameras' current responses and blur."""
        if not self._is_real:
            return self.compared(rendered)
        views = apart(self._respond(rendered), self._simulator.widths)
        both = zip(views, self.blurs, strict=True)
        return self.compared(np.concatenate([_blurred(view, *blurs) for view, blurs in both], 2))

    def _respond(self, rendered: np.ndarray) -> np.ndarray:
        """(M, H, W, 3) with the cameras' responses and exposures, before video compression."""
        if not self._is_real:
            return rendered
        views, exposures = apart(rendered, self._simulator.widths), np.exp(self.log_exposure).T
        cameras = zip(self.responses, views, exposures, strict=True)
        seen = [response(view, exposure) for response, view, exposure in cameras]
        return np.concatenate(seen, 2)

    def _render(self, moved: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(M, H, W, 3) of the full scale, from states moved by (M, D) standard deviations."""
        states = self._full_states
        if moved.shape[1]:
            tangent = np.einsum("md,mdt->mt", moved, self._poses)
            changed = self._space.move(self._space.positions_and_velocities(states), tangent)
            states = self._space.with_positions_and_velocities(states, changed)
        parameters = np.repeat(self._simulator.space.from_unit(unit)[None], len(states), 0)
        return self._simulator.render(states, parameters).astype(np.float32) / 255


def _within(covered: np.ndarray) -> np.ndarray:
    """(M, H, W) bool without a margin that smoothing and a slight move may take in."""
    around = generate_binary_structure(2, 2)[None]
    return binary_erosion(covered, around, _MARGIN_PX, border_value=1)


def _blurred(pictures: np.ndarray, soft: np.float32, chroma: np.float32) -> np.ndarray:
    """(M, H, W, 3) by a lens, then by a video; see `PictureScene`."""
    soft_ones = pictures + soft * _lost_sharpness(pictures)
    return soft_ones + chroma * _lost_chroma(soft_ones)


def _lost_sharpness(pictures: np.ndarray) -> np.ndarray:
    """(M, H, W, 3) change of pictures when they are smoothed once."""
    return smoothed(pictures) - pictures


def _lost_chroma(pictures: np.ndarray) -> np.ndarray:
    """(M, H, W, 3) change of pictures when their chroma is smoothed once."""
    return with_smooth_chroma(pictures, 1) - pictures
