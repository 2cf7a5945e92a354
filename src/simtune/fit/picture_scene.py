"""Pictures drawn for a fit: with other parameters, from slightly other states, by a camera."""

from typing import NamedTuple

import numpy as np

from simtune.fit.response import NUM_UNKNOWN, CameraResponse
from simtune.simulation import Simulator
from simtune.views import apart, parts
from simtune.vision.smoothing import with_smooth_chroma

SHOWN = 0.05  # of the full scale, that a pixel changes over a parameter's whole range
_DELTA = 0.03  # of a parameter, to derive by: several of a pixel's 256 levels
_WHITE = 254.5 / 255
_LARGEST_MOVE = 4.0  # standard deviations, of a pose


class Slopes(NamedTuple):
    """By how much pixels change, of the full scale."""

    shown: np.ndarray  # (V, M, pixels) by a parameter's unit coordinate
    chroma: np.ndarray  # (C, M, pixels) by the blur of a camera's chroma
    response: np.ndarray  # (5 C, M, pixels) by an unknown of a camera's response
    pose: np.ndarray  # (D, M, pixels) by a standard deviation of a pose

    @classmethod
    def none(cls, num: int) -> "Slopes":
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
    ):
        """`shown`: (V,) indices of the parameters that pictures tell; `poses`: see `fit_pictures`.

        `is_real`: the cameras have responses, which begin as none, and their colours come out of
        videos.
        """
        self._simulator, self._full_states, self._shown = simulator, full_states, shown
        self._space, self._is_real = simulator.state_space, is_real
        shape = (len(full_states), 0, self._space.num_tangent)
        self._poses = np.zeros(shape) if poses is None else poses
        self.moved = np.zeros(self._poses.shape[:2])  # (M, D) standard deviations
        self.response = np.zeros(NUM_UNKNOWN * len(simulator.widths) * is_real)  # (5 C,)
        # (C,) of its chroma, what each camera's video smooths, as a share of smoothing it once
        self.chroma_blur = np.zeros(len(simulator.widths) * is_real)
        self._is_white = np.zeros(0, bool)

    @property
    def responses(self) -> list[CameraResponse]:
        """One a camera; none where pictures are as drawn."""
        return [CameraResponse(its) for its in self.response.reshape(-1, NUM_UNKNOWN)]

    def move(self, change: np.ndarray) -> None:
        """The poses by (M, D)."""
        self.moved = np.clip(self.moved + change, -_LARGEST_MOVE, _LARGEST_MOVE)

    def compared(self, pictures: np.ndarray) -> np.ndarray:
        """(..., pixels) of (..., H, W, 3), a real camera's without fine chroma."""
        if self._is_real:
            views = apart(pictures, self._simulator.widths)
            pictures = np.concatenate([with_smooth_chroma(view) for view in views], -2)
        return pictures.reshape(*pictures.shape[:-3], -1)

    def draw(self, unit: np.ndarray) -> np.ndarray:
        """(M, pixels) as they are with (N,) parameters."""
        rendered = self._render(self._states(self.moved), unit)
        self._is_white = (rendered >= _WHITE).reshape(len(rendered), -1)
        return self._see(rendered)

    def is_overexposed(self, frames: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """(M, pixels) bool: as bright as can be in (M, H, W, 3) frames and in what was drawn last.

        How much brighter it would be, nothing tells: it holds no colour back that others say is
        brighter. `noise`: (M, pixels). Both are of the full scale.
        """
        white = self._respond(np.full((1, *frames.shape[1:]), _WHITE, np.float32)).reshape(1, -1)
        return self._is_white & (frames.reshape(len(frames), -1) >= white - noise)

    def derive(self, unit: np.ndarray, drawn: np.ndarray) -> Slopes:
        """Of the (M, pixels) that were drawn with (N,) parameters."""
        num_poses, states = self.moved.shape[1], self._states(self.moved)
        slopes = np.empty((len(self._shown), *drawn.shape), np.float32)
        for i, shown in enumerate(self._shown):
            # Darker, where there is room: what is brighter than white looks all the same.
            units, delta = unit.copy(), _DELTA if unit[shown] < _DELTA else -_DELTA
            units[shown] += delta
            slopes[i] = (self._see(self._render(states, units)) - drawn) / delta
        of_pose = np.empty((num_poses, *drawn.shape), np.float32)
        for i, one in enumerate(np.eye(num_poses)):
            moved = self._render(self._states(self.moved + one), unit)
            of_pose[i] = self._see(moved) - drawn
        of_chroma, of_response = self._derive_cameras(states, unit, drawn)
        # Where nothing that is fitted shows, no colour in a model is sure.
        of_chroma *= (np.abs(slopes) > SHOWN).any(0)
        return Slopes(slopes, of_chroma, of_response, of_pose)

    def _derive_cameras(
        self, states: np.ndarray, unit: np.ndarray, like: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(C, M, pixels) and (5 C, M, pixels), of which there are as many as `like`."""
        if not self._is_real:
            nothing = np.zeros((0, *like.shape), np.float32)
            return nothing, nothing
        rendered = self._render(states, unit)
        of_chroma = np.zeros((len(self.chroma_blur), *rendered.shape), np.float32)
        slopes = np.zeros((len(self.response), *rendered.shape), np.float32)
        each = zip(self.responses, parts(self._simulator.widths), strict=True)
        for number, (response, columns) in enumerate(each):
            view, its = rendered[:, :, columns], slice(NUM_UNKNOWN * number, None)
            slopes[its][:NUM_UNKNOWN, :, :, columns] = response.derive(view)
            of_chroma[number][:, :, columns] = _lost_chroma(response(view))
        return self.compared(of_chroma), self.compared(slopes)

    def _see(self, rendered: np.ndarray) -> np.ndarray:
        """(M, pixels) of (M, H, W, 3), by the cameras as they are now."""
        if not self._is_real:
            return self.compared(rendered)
        views = apart(self._respond(rendered), self._simulator.widths)
        blurs = self.chroma_blur.astype(np.float32)
        filmed = [v + blur * _lost_chroma(v) for v, blur in zip(views, blurs, strict=True)]
        return self.compared(np.concatenate(filmed, 2))

    def _respond(self, rendered: np.ndarray) -> np.ndarray:
        """(M, H, W, 3) the same, before they become videos."""
        if not self._is_real:
            return rendered
        views = zip(self.responses, apart(rendered, self._simulator.widths), strict=True)
        return np.concatenate([response(view) for response, view in views], 2)

    def _states(self, moved: np.ndarray) -> np.ndarray:
        """(M, S) states moved by (M, D) standard deviations."""
        if not moved.shape[1]:
            return self._full_states
        tangent = np.einsum("md,mdt->mt", moved, self._poses)
        states = self._space.positions_and_velocities(self._full_states)
        changed = self._space.move(states, tangent)
        return self._space.with_positions_and_velocities(self._full_states, changed)

    def _render(self, full_states: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(M, H, W, 3) of the full scale."""
        parameters = np.repeat(self._simulator.space.from_unit(unit)[None], len(full_states), 0)
        return self._simulator.render(full_states, parameters).astype(np.float32) / 255


def _lost_chroma(pictures: np.ndarray) -> np.ndarray:
    """(M, H, W, 3) what smoothing their chroma once adds to them."""
    return with_smooth_chroma(pictures, 1) - pictures
