"""Fits colours and light to pixels, once the motion says where everything is.

The detector's estimates are good to a few hundredths; comparing rendered pixels is good to a few
thousandths, if the simulator draws as the real world looks. A state that is a fifth of a pixel off
shades round bodies differently, by about a hundredth in all colours alike. So each picture's pose
is an unknown too, as far as the motion leaves it open.
"""

from dataclasses import dataclass

import numpy as np

from simtune.fit.combine import FIRST_VARIANCE, combine, robust_weights
from simtune.fit.pictures.pixel_noise import noise_by_parameter, noise_by_pixel, rounding_std
from simtune.fit.pictures.pose_elimination import without_poses
from simtune.fit.pictures.response import (
    NUM_CHANNELS,
    NUM_UNKNOWN,
    CameraResponse,
    ResponseStep,
    step_by_known_colours,
)
from simtune.fit.pictures.scene import SHOWN, PictureScene, PixelSlopes
from simtune.simulation import Simulator
from simtune.vision.image_noise import ImageNoise

_ROBUST_STDS = 3.0  # of noise, from which a pixel counts less: edges, unmodelled things
_SMALLEST_NOISE = 1.0 / 255
_FIRST_NOISE = 0.1  # at least, halved in each iteration: a colour far off is no outlier yet
_LARGEST_STEP = 0.2
# Pixels are linear in colours, nearly, so damping is weak: as if they were known within the whole
# range. As long as an object of a few pixels has another colour, its pixels count as noisy, and
# stronger damping let it take .03 in each iteration.
_DAMPING_STD = 1.0
_ITERATIONS = 12, 30  # at least; at most, until no parameter moves more than _SETTLED_STDS
_SETTLED_STDS = 0.3
_SQUARE_PX = 4  # neighbouring pixels are correlated: a square of 4 × 4 counts as one
_MAX_OTHER_SHARE = 0.3  # of other colours in a pixel, relative to it being all white
_RIDGE = 1e-6  # of information, for what no picture shows
_EXPOSURE_STD = 0.1  # prior of a picture's log exposure, which automatic cameras let drift
_DERIVED_EVERY = 2  # iterations: derivatives cost most, and change slowly


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """M pictures to fit, and prior knowledge about them."""

    frames: np.ndarray  # (M, H, W, 3) uint8
    full_states: np.ndarray  # (M, S)
    # (M, D, 2 nv) possible errors of each picture's state, one standard deviation each
    poses: np.ndarray | None = None
    # Prior of the cameras; None: pictures are the simulator's own
    camera_noise: ImageNoise | None = None


@dataclass(frozen=True)
class PictureFit:
    """Result, in unit coordinates of the V visible parameters."""

    unit: np.ndarray  # (V,)
    covariance: np.ndarray  # (V, V); 0 for known parameters
    noise: np.ndarray  # (V,) robust std of the pixels that show each, of the full scale
    responses: list[CameraResponse]  # one per camera; none if pictures are the simulator's own
    blur: np.ndarray  # (C, 2) of pictures and of their chroma, see `PictureScene`; empty then
    log_exposure: np.ndarray  # (M, C), of each picture; empty then

    @classmethod
    def of_nothing(cls) -> "PictureFit":
        """Where no parameter is visible."""
        none = np.empty(0)
        return cls(none, np.empty((0, 0)), none, [], np.empty((0, 2)), np.empty((0, 0)))


def fit_pictures(
    simulator: Simulator,
    pictures: Pictures,
    parameters: np.ndarray,
    shown: np.ndarray,
    is_known: np.ndarray | None = None,
) -> PictureFit:
    """Fit the visible parameters, (V,) indices `shown`, and the cameras' responses and blur.

    `parameters`: (N,) initial values; those not in `shown` are kept, and so are the known ones
    among `shown`, `is_known` (V,) bool.

    Responses are fitted only to known colours: highlights would also separate gain from colour, if
    only the simulator drew them correctly. The uncertainty of a response propagates to colours, but
    unknown colours do not inform the response (a cut posterior: Plummer 2015).
    """
    known = np.zeros(len(shown), bool) if is_known is None else is_known
    fit = _Fit(simulator, pictures, simulator.space.to_unit(parameters), shown, known)
    fewest, most = _ITERATIONS
    for iteration in range(most):
        if fit.iterate(iteration) <= _SETTLED_STDS and iteration + 1 >= fewest:
            break
    return fit.result()


class _Fit:
    """Gauss-Newton steps of colours, camera responses, blur and poses."""

    def __init__(self, simulator, pictures: Pictures, unit, shown, known):
        self._unit, self._shown, self._known = unit, shown, known
        self._fitted, self._camera = shown[~known], pictures.camera_noise
        is_real, states = self._camera is not None, pictures.full_states
        parameters = simulator.space.from_unit(unit)
        self._scene = PictureScene(simulator, states, shown, pictures.poses, is_real, parameters)
        self._slopes = PixelSlopes.none(len(states))
        self._frames = pictures.frames.astype(np.float32) / 255
        self._real = self._scene.compared(self._frames)
        self._variance, self._covariance = FIRST_VARIANCE, np.zeros((len(self._fitted),) * 2)

    def iterate(self, number: int) -> float:
        """The farthest that a parameter moved, in its standard deviations."""
        scene, drawn = self._scene, self._scene.draw(self._unit)
        if number % _DERIVED_EVERY == 0:
            self._slopes = scene.derive(self._unit, drawn)
        slopes, residual = self._slopes, drawn - self._real
        noise = noise_by_pixel(
            residual, slopes.shown, max(_SMALLEST_NOISE, _FIRST_NOISE / 2**number)
        )
        robust = 1 / (1 + np.square(residual / (_ROBUST_STDS * noise))) ** 2
        robust[scene.is_overexposed(self._frames, noise)] = 0
        cameras = self._see_known(drawn, residual, robust)
        trust = robust_weights(np.minimum(np.square(residual / noise), 9).mean(1))
        unknowns = np.concatenate([slopes.shown[~self._known], slopes.blur, slopes.response])
        weight = robust / noise**2 / _SQUARE_PX**2
        equations = without_poses(unknowns, slopes.pose, weight, residual, scene.moved)
        information, slope = equations.information, equations.shared_gradient
        few, num = len(self._fitted), len(self._fitted) + len(scene.blur)
        colours = combine(information[:, :num, :num], slope[:, :num], self._variance, trust)
        leads = np.einsum("m,mpq->pq", trust, information[:, :num])
        leads = np.linalg.solve(leads[:, :num] + _RIDGE * np.eye(num), leads[:, num:])  # −du/dρ
        self._covariance = colours.covariance + leads @ cameras.covariance @ leads.T
        self._variance, before = colours.variance, np.append(self._unit[self._fitted], scene.blur)
        largest = np.where(np.arange(num) < few, _LARGEST_STEP, np.inf)
        step = colours.step(before, largest, _DAMPING_STD)
        after = np.clip(before + step, 0, 1)
        self._unit[self._fitted], scene.blur = after[:few], after[few:]
        scene.response = scene.response + cameras.step
        went = np.concatenate([after - before, cameras.step])
        scene.move(equations.own_step(went))
        scene.log_exposure = exposed(scene.log_exposure, slopes, weight, residual)
        std = np.sqrt(np.diag(self._covariance))[:few]
        return float((np.abs(after - before)[:few] / std).max(initial=0))

    def result(self) -> PictureFit:
        drawn, slopes, known = self._scene.draw(self._unit), self._slopes.shown, self._known
        noise = noise_by_parameter(drawn - self._real, np.abs(slopes) > SHOWN, _SMALLEST_NOISE)
        rounding = np.square([rounding_std(slope, drawn) for slope in slopes[~known]])
        covariance = np.zeros((len(known),) * 2)
        few = len(self._fitted)
        covariance[np.ix_(~known, ~known)] = self._covariance[:few, :few] + np.diag(rounding)
        scene = self._scene
        cameras = scene.responses, scene.blurs, scene.log_exposure
        return PictureFit(self._unit[self._shown], covariance, noise, *cameras)

    def _see_known(
        self, drawn: np.ndarray, residual: np.ndarray, usually: np.ndarray
    ) -> ResponseStep:
        slopes, known = self._slopes, self._known
        shows = _shows(slopes.shown[known], self._unit[self._shown[known]], drawn)
        usual, at = self._camera or ImageNoise(), self._scene.response
        return step_by_known_colours(slopes.response, usually * shows, residual, drawn, usual, at)


def exposed(
    log_exposure: np.ndarray, slopes: PixelSlopes, weight: np.ndarray, residual: np.ndarray
) -> np.ndarray:
    """(M, C) logarithms of exposures after a Gauss-Newton step; (M, pixels) weights and residuals.

    They have a prior around 0, and their mean over a camera's pictures stays 0: what is common to
    all is the camera's gain, or the colours. Only pixels count that show a parameter.
    """
    shows = (np.abs(slopes.shown) > SHOWN).any(0)
    stepped = np.empty_like(log_exposure)
    for camera, before in enumerate(log_exposure.T):
        gains = slopes.response[NUM_UNKNOWN * camera :][:NUM_CHANNELS]
        slope = gains.sum(0) * shows  # each pixel belongs to one channel
        information = (weight * slope**2).sum(1) + _EXPOSURE_STD**-2
        pull = (weight * slope * residual).sum(1) + before / _EXPOSURE_STD**2
        stepped[:, camera] = before - pull / information
    return stepped - stepped.mean(0)


def _shows(slopes: np.ndarray, unit: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(M, pixels) bool: where (K,) parameters make up nearly all of what was drawn."""
    white = np.abs(slopes).sum(0)
    others = np.abs(drawn - np.einsum("kmp,k->mp", slopes, unit))
    return (white > SHOWN) & (others < _MAX_OTHER_SHARE * white)
