"""Sensitivity of pictures, motion and readings to parameters, and Fisher information at best.

Nothing is learnt: the simulator is run with one parameter changed at a time.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simtune.fit.motion.shooting import Shooting
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.fit.readings.sensitivity import MOST_EPISODES, ReadingChanges
from simtune.observation import AllEvidence, ObservationModel
from simtune.parameters import ParameterSpace
from simtune.progress import ReportProgress, silent
from simtune.randomization import Distribution
from simtune.simulation import Points, Rollouts, Simulator
from simtune.vision.image_noise import ImageNoise
from simtune.vision.keypoint_tracks import KeypointTracks
from simtune.vision.keypoints import Keypoints, find_keypoints

WINDOW_STEPS = 12  # no fit follows chaotic motion for longer
_FACTOR, _TENTH = 1.2, 0.1  # change of a parameter on a log scale (factor), on a linear one
_LEVELS = 2  # of 256: a pixel that changes by no more looks the same
_STILL_PX = 0.01  # less is no motion: a detector's errors are fifty times as large
_DETECTOR_PX, _SURE = 0.5, 0.98  # assumed error of the detector; its probability of the right place
_NUM_PICTURES = 24


@dataclass(frozen=True)
class Sensitivity:
    """Of N parameters: what each one changes, and how well it could be known at best."""

    parameters: np.ndarray  # (N,) at which this holds
    changed: np.ndarray  # (N,) the changed value of each, one at a time
    levels: np.ndarray  # (N,) of 256, mean change of the pixels that change
    pixel_share: np.ndarray  # (N,) of pixels that change
    rms_px: np.ndarray  # (N,) displacement of keypoints after WINDOW_STEPS steps
    largest_px: np.ndarray  # (N,)
    # Standard deviations, of the logarithm on a log scale, at most those of a uniform prior over
    # the first range of a search:
    motion_std: np.ndarray  # (N,)
    picture_std: np.ndarray  # (N,) from colours, as far as a camera shows them truly
    first_width: np.ndarray  # (N,) of that range
    correlation: np.ndarray  # (N, N) of errors in estimates from motion; 0 without effect on motion
    sees_pictures: bool = True  # False without a camera
    readings: ReadingChanges | None = None  # of joints; they count as motion in `motion_std`

    @property
    def shows_nothing(self) -> np.ndarray:
        """(N,) bool."""
        unseen = (self.pixel_share == 0) & (self.largest_px <= _STILL_PX)
        return unseen if self.readings is None else unseen & ~self.readings.changes


def analyze(
    simulator: Simulator,
    actions: np.ndarray,
    seed: int,
    observation: ObservationModel,
    readings: ReadingChanges | None = None,
    report: ReportProgress = silent,
) -> Sensitivity:
    """At the nominal parameters, in episodes of (E, T, A) actions; `readings`: those of joints.

    Raises RuntimeError if all of them diverge.
    """
    space = simulator.space
    nominal = where_analyzed(space)
    first = Distribution.first(space, nominal)
    changed = one_by_one(space, nominal)
    scale = _along_scale(space, space.high) - _along_scale(space, space.low)
    width = scale * first.unit_width
    prior = width / np.sqrt(12)  # of a uniform distribution
    information, seen = np.diag(prior**-2), _Seen.nothing(len(space))
    if simulator.views:
        seen = _look(simulator, first, actions, seed, changed, report)
        information += seen.information / np.outer(scale, scale)
    if readings is not None:
        information += readings.information / np.outer(scale, scale)
    covariance = np.linalg.inv(information)
    std = np.sqrt(np.diag(covariance))
    step = np.diag(_along_scale(space, changed) - _along_scale(space, nominal))
    by_picture = np.full(len(space), np.inf)
    if simulator.views:
        error = _colour_error(seen.share * math.prod(simulator.shape), observation)
        by_picture = step * error / np.maximum(seen.levels, 1e-9)
    return Sensitivity(
        parameters=nominal,
        changed=np.diag(changed),
        levels=seen.levels,
        pixel_share=seen.share,
        rms_px=seen.rms,
        largest_px=seen.largest,
        motion_std=std,
        picture_std=(by_picture**-2 + prior**-2) ** -0.5,
        first_width=width,
        correlation=covariance / np.outer(std, std) - np.eye(len(space)),
        sees_pictures=bool(simulator.views),
        readings=readings,
    )


class _Seen(NamedTuple):
    """What cameras see of N parameters; see `Sensitivity`."""

    levels: np.ndarray
    share: np.ndarray
    rms: np.ndarray
    largest: np.ndarray
    information: np.ndarray  # (N, N) Fisher information, in unit coordinates

    @classmethod
    def nothing(cls, num: int) -> "_Seen":
        none = np.zeros(num)
        return cls(none, none, none, none, np.zeros((num, num)))


def _look(
    simulator: Simulator,
    first: Distribution,
    actions: np.ndarray,
    seed: int,
    changed: np.ndarray,
    report: ReportProgress,
) -> _Seen:
    """What cameras see of (N, N) parameters, one changed in each row; see `analyze`."""
    space, rng = simulator.space, np.random.default_rng((seed, 1))
    keypoints, more = find_keypoints(simulator, first, seed), max(1.0, len(actions) / MOST_EPISODES)
    actions = actions[:MOST_EPISODES]
    worlds = np.tile(where_analyzed(space), (len(actions), 1))
    episodes = simulator.roll_out(worlds, actions.astype(float), rng, keypoints.observe)
    if not len(episodes):
        raise RuntimeError("every episode diverged; check the timestep and the actions")
    report("changing one parameter after the other", 0.6)
    levels, share = picture_changes(simulator, episodes, changed)
    moves = ~space.is_appearance
    rms, largest = np.zeros((2, len(space)))
    rms[moves], largest[moves] = motion_changes(simulator, keypoints, episodes, changed[moves])
    moving, information = np.flatnonzero(largest > _STILL_PX), np.zeros((len(space),) * 2)
    if len(moving):
        report("asking how well the best fit could tell", 0.8)
        best = motion_covariance(simulator, keypoints, episodes, moving)
        information[np.ix_(moving, moving)] = more * np.linalg.inv(best)
    return _Seen(levels, share, rms, largest, information)


def one_by_one(space: ParameterSpace, parameters: np.ndarray) -> np.ndarray:
    """(N, N) copies of the (N,) parameters, row i with parameter i changed, away from its bound."""
    scale = _along_scale(space, space.high) - _along_scale(space, space.low)
    step = np.where(space.is_log, np.log(_FACTOR) / scale, _TENTH)
    unit = space.to_unit(parameters)
    return space.from_unit(unit + np.diag(np.where(unit + step > 1, -step, step)))


def picture_changes(
    simulator: Simulator, episodes: Rollouts, changed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(G,) levels and shares of the pixels that differ with (G, N) parameters, in equal states."""
    rows = episodes.states.reshape(-1, episodes.states.shape[-1])
    rows = rows[np.linspace(0, len(rows) - 1, _NUM_PICTURES).astype(int)]
    worlds = np.concatenate([episodes.parameters[:1], changed])
    frames = simulator.render(np.tile(rows, (len(worlds), 1)), np.repeat(worlds, len(rows), 0))
    frames = frames.reshape(len(worlds), -1, 3).astype(np.int16)
    levels, share = np.zeros((2, len(changed)))
    for i, drawn in enumerate(frames[1:]):
        change = np.abs(drawn - frames[0]).max(-1)
        changes = change > _LEVELS
        share[i] = changes.mean()
        levels[i] = change[changes].mean() if changes.any() else 0
    return levels, share


def motion_changes(
    simulator: Simulator, keypoints: Keypoints | Points, episodes: Rollouts, changed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(G,) pixels of keypoint displacement with (G, N) parameters: root mean square, largest.

    At the end of windows that begin in the same states with the same actions.
    """
    starts, actions = windows(episodes)
    worlds = np.concatenate([episodes.parameters[:1], changed])
    played = simulator.roll_out(
        np.repeat(worlds, len(starts), 0),
        np.tile(actions, (len(worlds), 1, 1)),
        np.random.default_rng(0),  # starts are given: nothing is drawn
        keypoints.observe,
        starts=np.tile(starts, (len(worlds), 1)),
        keep_diverged=True,
    )
    ends = played.observed[:, -1].reshape(len(worlds), -1, 2)
    distance = np.nan_to_num(np.linalg.norm(ends[1:] - ends[0], axis=-1))
    if not distance.size:  # no keypoints
        return np.zeros(len(changed)), np.zeros(len(changed))
    return np.sqrt(np.square(distance).mean(-1)), distance.max(-1)


def windows(episodes: Rollouts) -> tuple[np.ndarray, np.ndarray]:
    """(W, S) initial states and (W, K, A) actions of all windows, which do not overlap."""
    num_episodes, num_steps, num_actions = episodes.actions.shape
    length = min(WINDOW_STEPS, num_steps)
    count = num_steps // length
    starts = episodes.states[:, : count * length : length]
    actions = episodes.actions[:, : count * length]
    shape = (num_episodes * count, length, num_actions)
    return starts.reshape(shape[0], -1), actions.reshape(shape)


def motion_covariance(
    simulator: Simulator, keypoints: Keypoints | Points, episodes: Rollouts, fitted: np.ndarray
) -> np.ndarray:
    """(P, P) covariance in unit coordinates of the `fitted` parameters, at best."""
    physics = Physics(simulator, keypoints.observe, episodes.states[0, 0])
    states = physics.states(episodes.states)
    # A guess is as uncertain as these episodes vary; Shooting multiplies its std by 3.
    prior_std = physics.space.difference(states, states[:1, :1]).std((0, 1)) / 3
    config = ShootingConfig(stages=(Stage(WINDOW_STEPS, 0),))
    shooting = Shooting(physics, np.maximum(prior_std, 1e-3), fitted, config)
    candidates = episodes.observed.reshape(*states.shape[:2], 1, -1, 2).repeat(2, 2)
    probability = np.zeros(candidates.shape[:-1])
    probability[:, :, 0] = _SURE
    noise_px = np.full(len(keypoints), _DETECTOR_PX)
    tracks = KeypointTracks(candidates, probability, noise_px, simulator.shape)
    observed = Observed(AllEvidence((tracks,)), episodes.actions)
    return shooting.fisher_covariance(observed, states, episodes.parameters[0])


def _along_scale(space: ParameterSpace, parameters: np.ndarray) -> np.ndarray:
    """(..., N) logarithms on a log scale, else the values."""
    return np.where(space.is_log, np.log(np.where(space.is_log, parameters, 1.0)), parameters)


def _colour_error(num_pixels: np.ndarray, observation: ObservationModel) -> np.ndarray:
    """(N,) levels, the error of a mean colour over so many pixels; at least 1 by rounding."""
    added = observation.image_noise or ImageNoise(offset=0, noise=0)
    noise = added.noise / np.sqrt(np.maximum(num_pixels, 1))
    return np.hypot(1, 255 * np.hypot(added.offset, noise))


def where_analyzed(space: ParameterSpace) -> np.ndarray:
    """(N,) nominal values, but a tenth of the longest delay for one of 0: motion jumps near 0."""
    return np.where(space.is_delay & (space.nominal == 0), _TENTH * space.high, space.nominal)
