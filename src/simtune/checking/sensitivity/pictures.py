"""What parameters change in pictures and in the motion that these show."""

from typing import NamedTuple

import numpy as np

from simtune.budget import NO_LIMIT, Budget
from simtune.fit.motion.shooting import Shooting
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.observation import AllEvidence
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.simulation import Points, Rollouts, Simulator
from simtune.tuning.pace import MOST_REPLAYED
from simtune.vision.keypoint_tracks import KeypointTracks
from simtune.vision.keypoints import Keypoints, find_keypoints

WINDOW_STEPS = 12  # no fit follows chaotic motion for longer
_SAME_LEVELS = 2  # of 256: a pixel that changes by no more looks the same
STILL_PX = 0.01  # less is no motion: a detector's errors are fifty times as large
_DETECTOR_ERROR_PX, _DETECTOR_PROBABILITY = 0.5, 0.98  # assumed; of the right place
_NUM_PICTURES = 24


class CameraChanges(NamedTuple):
    """What cameras see of N parameters."""

    levels: np.ndarray  # (N,) of 256, mean change of the pixels that change
    pixel_share: np.ndarray  # (N,) of pixels that change
    rms_px: np.ndarray  # (N,) displacement of keypoints after WINDOW_STEPS steps
    largest_px: np.ndarray  # (N,)
    information: np.ndarray  # (N, N) Fisher information, in unit coordinates
    asked_share: float = 1.0  # of the motion: the rest is assumed to tell as much

    @classmethod
    def nothing(cls, num: int) -> "CameraChanges":
        none = np.zeros(num)
        return cls(none, none, none, none, np.zeros((num, num)))


def camera_changes(
    simulator: Simulator,
    first: Distribution,
    actions: np.ndarray,
    seed: int,
    nominal: np.ndarray,
    changed: np.ndarray,
    budget: Budget,
) -> CameraChanges:
    """What cameras see of (N, N) parameters, one of the (N,) `nominal` ones changed in each row.

    `budget`: for how well the best fit could tell; of motion that it leaves no time for,
    `asked_share` says so. Raises RuntimeError if all episodes of (E, T, A) actions diverge.
    """
    space, rng = simulator.space, stream(seed, Purpose.CAMERA_CHANGES)
    budget.report("choosing keypoints", 0.0)
    keypoints = find_keypoints(simulator, first, seed)
    # Episodes that are not played are assumed to tell as much
    more, actions = max(1.0, len(actions) / MOST_REPLAYED), actions[:MOST_REPLAYED]
    worlds = np.tile(nominal, (len(actions), 1))
    episodes = simulator.roll_out(worlds, actions.astype(float), rng, keypoints.observe)
    if not len(episodes):
        raise RuntimeError("every episode diverged; check the timestep and the actions")
    budget.report("changing one parameter after the other", 0.2)
    levels, share = picture_changes(simulator, episodes, changed)
    moves = ~space.is_appearance
    rms, largest = np.zeros((2, len(space)))
    rms[moves], largest[moves] = motion_changes(simulator, keypoints, episodes, changed[moves])
    moving, information = np.flatnonzero(largest > STILL_PX), np.zeros((len(space),) * 2)
    asked_share = 1.0
    if len(moving):
        asking = budget.part(budget.seconds, (0.4, 1.0))
        best, asked_share = motion_covariance(simulator, keypoints, episodes, moving, asking)
        information[np.ix_(moving, moving)] = more * np.linalg.inv(best)
    return CameraChanges(levels, share, rms, largest, information, asked_share)


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
        changes = change > _SAME_LEVELS
        share[i] = changes.mean()
        levels[i] = change[changes].mean() if changes.any() else 0
    return levels, share


def motion_changes(
    simulator: Simulator, keypoints: Keypoints | Points, episodes: Rollouts, changed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(G,) pixels of keypoint displacement with (G, N) parameters: root mean square, largest.

    At the end of windows that begin in the same states with the same actions.
    """
    starts, actions = short_plays(episodes)
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


def short_plays(episodes: Rollouts) -> tuple[np.ndarray, np.ndarray]:
    """(W, S) initial states and (W, K, A) actions of all windows, which do not overlap."""
    num_episodes, num_steps, num_actions = episodes.actions.shape
    length = min(WINDOW_STEPS, num_steps)
    count = num_steps // length
    starts = episodes.states[:, : count * length : length]
    actions = episodes.actions[:, : count * length]
    shape = (num_episodes * count, length, num_actions)
    return starts.reshape(shape[0], -1), actions.reshape(shape)


def motion_covariance(
    simulator: Simulator,
    keypoints: Keypoints | Points,
    episodes: Rollouts,
    fitted: np.ndarray,
    budget: Budget = NO_LIMIT,
) -> tuple[np.ndarray, float]:
    """(P, P) covariance in unit coordinates of the `fitted` parameters, at best.

    And the share of the motion that the `budget` had time to ask.
    """
    physics = Physics(simulator, keypoints.observe, episodes.states[0, 0])
    states = physics.states(episodes.states)
    # A guess is as uncertain as these episodes vary; Shooting multiplies its std by 3.
    prior_std = physics.space.difference(states, states[:1, :1]).std((0, 1)) / 3
    config = ShootingConfig(stages=(Stage(WINDOW_STEPS, 0),))
    shooting = Shooting(physics, np.maximum(prior_std, 1e-3), fitted, config)
    candidates = episodes.observed.reshape(*states.shape[:2], 1, -1, 2).repeat(2, 2)
    probability = np.zeros(candidates.shape[:-1])
    probability[:, :, 0] = _DETECTOR_PROBABILITY
    noise_px = np.full(len(keypoints), _DETECTOR_ERROR_PX)
    tracks = KeypointTracks(candidates, probability, noise_px, simulator.shape)
    observed = Observed(AllEvidence((tracks,)), episodes.actions)
    return shooting.fisher_covariance(observed, states, episodes.parameters[0], budget)
