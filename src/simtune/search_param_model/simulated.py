"""Simulated worlds for the posterior SPM: played whole, drawn only in part."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from simtune.observation import ObservationModel
from simtune.simulation import AnySimulator, Points, Rollouts, Simulator
from simtune.simulation.loose_objects import astray, loose_places, scattered
from simtune.trajectory import delayed
from simtune.vision.keypoints import Keypoints

_STREWN_WIDTH = 2.0  # of the places of loose objects, relative to where episodes begin


class NearlyAllDiverged(RuntimeError):
    """Too few worlds are left to learn from."""


@dataclass(frozen=True)
class SimulatedWorlds:
    """One round of simulation: W worlds of E episodes of T steps each."""

    parameters: np.ndarray  # (W, N)
    actions: np.ndarray  # (W, E, T, A)
    keypoints: np.ndarray  # (W, E, T + 1, L, 2) pixels, true

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The worlds of several parts."""
        return cls(
            **{name: _joined([vars(part)[name] for part in parts]) for name in vars(parts[0])}
        )


@dataclass(frozen=True)
class FilmedWorlds(SimulatedWorlds):
    """With pictures of each world's first episode: of a stretch of F successive steps."""

    frames: np.ndarray  # (W, F, H, W, 3) uint8
    filmed_from: np.ndarray  # (W,) step of the first frame
    states: np.ndarray  # (W, F, S) full states of `frames`
    # {sensor: (W, F, D)} measured with `frames`
    readings: dict[str, np.ndarray] = field(default_factory=dict)

    def filmed_keypoints(self) -> np.ndarray:
        """(W, F, L, 2) true keypoints in `frames`."""
        at = self.filmed_from[:, None] + np.arange(self.frames.shape[1])
        return self.keypoints[np.arange(len(at))[:, None], 0, at]

    def keypoint_errors(self, found: np.ndarray) -> np.ndarray:
        """(W, F, L, 2) pixels by which keypoints found in `frames`, (W · F, L, 2), are off."""
        true = self.filmed_keypoints()
        return found.reshape(true.shape) - true

    def filmed_actions(self) -> np.ndarray:
        """(W, F − 1, A) between `frames`."""
        at = self.filmed_from[:, None] + np.arange(self.frames.shape[1] - 1)
        return self.actions[np.arange(len(at))[:, None], 0, at]


def _joined(parts: Sequence[Any]) -> Any:
    """Arrays of several worlds each, or {sensor: such arrays}."""
    if isinstance(parts[0], np.ndarray):
        return np.concatenate(parts)
    return {name: np.concatenate([its[name] for its in parts]) for name in parts[0]}


@dataclass(frozen=True)
class PlayedWorlds:
    """W worlds of E episodes, before anything is drawn."""

    simulator: AnySimulator
    keypoints: Keypoints | Points
    observation: ObservationModel
    actions: np.ndarray  # (W, E, T, A) as recorded
    rollouts: Rollouts  # of the episodes of all worlds, and of some that are left out
    whole: np.ndarray  # (W, E) positions in `rollouts`

    @property
    def parameters(self) -> np.ndarray:
        """(W, N)"""
        return self.rollouts.parameters[self.whole[:, 0]]

    def unfilmed(self) -> SimulatedWorlds:
        """All worlds, without frames."""
        return SimulatedWorlds(self.parameters, self.actions, self._points())

    def filmed(self, num_frames: int, rng: np.random.Generator) -> FilmedWorlds:
        """With `num_frames` successive frames of each world's first episode."""
        num, steps = len(self.whole), self.actions.shape[2]
        num_frames = min(num_frames, steps + 1)
        start = rng.integers(0, steps + 2 - num_frames, num)
        at = start[:, None] + np.arange(num_frames)
        states = self.rollouts.states[self.whole[:, :1], at]
        shown = replace(self.rollouts, parameters=self.parameters, states=states)
        frames = self.simulator.film(shown, self.observation.stray_light(num, rng))
        self.observation.add_noise(self.simulator, frames, rng)
        measured = self.rollouts.observed[self.whole[:, :1], at, 2 * len(self.keypoints) :]
        readings = self.observation.readings(measured, rng)
        return FilmedWorlds(
            **vars(self.unfilmed()),
            frames=frames,
            filmed_from=start,
            states=states,
            readings=readings,
        )

    def _points(self) -> np.ndarray:
        points = self.rollouts.observed[self.whole, :, : 2 * len(self.keypoints)]
        return points.astype(np.float32).reshape(*points.shape[:-1], -1, 2)


def play_worlds(
    simulator: AnySimulator,
    keypoints: Keypoints | Points,
    parameters: np.ndarray,
    actions: np.ndarray,
    rng: np.random.Generator,
    observation: ObservationModel,
) -> PlayedWorlds:
    """Play (W, E, T, A) actions in W worlds of (W, N) parameters.

    If actions may be late, they are, by a step, in half of the worlds, unless a parameter is a
    delay. In half of the episodes loose objects begin in other places than the task's, since they
    are pushed there later. Worlds with a diverged episode are left out, and those with an object
    that went astray, since it would be all that a network of states learns. Raises
    NearlyAllDiverged if hardly any is left.
    """
    num_episodes, played = actions.shape[1], actions.astype(float)
    if observation.unknown_latency_steps(simulator):
        late = rng.random(len(actions)) < 0.5
        played[late] = delayed(played[late], 1)
    rollouts = _roll_out(
        simulator,
        np.repeat(parameters, num_episodes, axis=0),
        played.reshape(len(played) * num_episodes, *actions.shape[2:]),  # there may be no actions
        rng,
        observation.observe_beside(keypoints.observe),
    )
    if isinstance(simulator, Simulator) and loose_places(simulator.model):
        lost = astray(simulator.model, simulator.state_space, rollouts.states)
        rollouts = rollouts.only(~lost)
    whole = whole_sets(rollouts.index, num_episodes)
    if len(whole) < 4:  # some for training, some to measure errors
        raise NearlyAllDiverged("nearly every world diverged; check the timestep and the bounds")
    kept = actions[rollouts.index[whole[:, 0]] // num_episodes]
    return PlayedWorlds(simulator, keypoints, observation, kept, rollouts, whole)


def _roll_out(
    simulator: AnySimulator,
    parameters: np.ndarray,
    actions: np.ndarray,
    rng: np.random.Generator,
    observe: Callable[[Any], np.ndarray],
) -> Rollouts:
    """As the simulator's own, but loose objects begin elsewhere in half of the episodes."""
    if not isinstance(simulator, Simulator) or not (loose := loose_places(simulator.model)):
        return simulator.roll_out(parameters, actions, rng, observe)
    starts = simulator.begin(parameters, rng).states[:, 0]
    strewn = scattered(simulator.state_space, starts, loose, _STREWN_WIDTH, rng)
    starts = np.where(rng.random((len(starts), 1)) < 0.5, strewn, starts)
    return simulator.roll_out(parameters, actions, rng, observe, starts, is_beginning=True)


def whole_sets(index: np.ndarray, episodes: int) -> np.ndarray:
    """(W, E) positions in `index` (n,) of the complete sets of E successive episodes."""
    _, start, count = np.unique(index // episodes, return_index=True, return_counts=True)
    return start[count == episodes, None] + np.arange(episodes)
