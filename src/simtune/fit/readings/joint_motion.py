"""The motion of a robot whose joints are read, known before its pictures are looked at.

If everything is read except loose objects, the parameters that the readings determined give the
robot's states: an open-loop replay, corrected by what readings differ from it for longer than noise
does. Then only the objects' states are unknown in windows. That is a third of the unknowns, and
windows can be longer: with ALOHA's arms, a box's mass can at best be known to 6 %, not to 19 %.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from simtune.fit.lateness import PICTURES
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.readings import Readings, filled, parabolas
from simtune.fit.readings.whole_episodes import begin_whole
from simtune.normal import MAD_TO_STD
from simtune.observation import AllEvidence, JointReadings
from simtune.vision.keypoint_tracks import KeypointTracks
from simtune.vision.keypoints import Keypoints

_CALM_ROWS, _QUICK_ROWS = 9, 3  # to which a parabola is fitted
_MISSED_STDS = 4.0  # of noise, by which a calm parabola misses what is quick
_UNIT_STEP, _STILL_PX = 0.02, 1e-3  # change of a parameter; movement that is none
_KEYPOINT_WORLDS = 8  # in which keypoints are looked at
_OFFSET_ROUNDS = 3  # in which offsets and initial states are found in turn


@dataclass(frozen=True)
class JointMotion:
    """Finds the states of all joints but those of loose objects."""

    loop: OpenLoopReplay
    finds_offset: np.ndarray  # (D,) bool, of the readings

    @property
    def is_known(self) -> np.ndarray:
        """(2 nv,) bool: which tangents of a state are known."""
        return ~np.tile(self.loop.measured.is_loose, 2)

    def find(
        self, observed: Observed, states: np.ndarray, parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(E, T + 1, nq + nv) states, and (D,) offsets of the encoders.

        Loose objects are as in the guesses `states`, (E, T + 1, nq + nv).
        """
        unit = self.loop.physics.parameters.to_unit(parameters)
        parts = observed.evidence.parts
        values = np.concatenate([p.values for p in parts if isinstance(p, JointReadings)], -1)
        readings, offsets = Readings(observed.actions, values), np.zeros(len(self.finds_offset))
        for _ in range(_OFFSET_ROUNDS if self.finds_offset.any() else 0):
            _, predicted = self._replay(readings, unit, offsets)
            offsets = np.where(self.finds_offset, told_offsets(values - predicted), 0.0)
        replayed, predicted = self._replay(readings, unit, offsets)
        left = smoothed(filled(values - offsets - predicted))
        moved = self.loop.measured.corrected(replayed, *left)
        rows = moved.reshape(-1, moved.shape[-1])
        rows = self.loop.measured.consistent.near(rows, np.repeat(unit[None], len(rows), 0))
        return self._with_objects(rows.reshape(moved.shape), states), offsets

    def _replay(
        self, readings: Readings, unit: np.ndarray, offsets: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(E, T + 1, nq + nv) states and (E, T + 1, D) predictions, without objects in the way."""
        physics = self.loop.physics
        whole, begun = begin_whole(self.loop, readings, unit, offsets)
        units = np.repeat(unit[None], len(begun), 0)
        begun = self.loop.measured.consistent.near(begun, units)
        full_states, seen = physics.play(begun, units, whole.actions, whole.actuator_states)
        return physics.states(full_states), seen

    def _with_objects(self, robot: np.ndarray, objects: np.ndarray) -> np.ndarray:
        measured = self.loop.measured
        is_object = np.concatenate([measured.is_loose_position, measured.is_loose])
        return np.where(is_object, objects, robot)


def told_offsets(missed: np.ndarray) -> np.ndarray:
    """(D,) medians of (E, T, D) readings less replays; 0 where they vary by half of that or more.

    While a gripper holds something, it is far from where it would be if nothing were in its way.
    """
    missed = np.where(np.isfinite(missed).any((0, 1)), missed, 0.0)  # never read: 0, too
    usual, varies = np.nanmedian(missed, (0, 1)), np.nanstd(missed, (0, 1))
    return np.where(np.abs(usual) > 2 * varies, usual, 0.0)


def smoothed(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(E, T, D) values without their noise, and their changes per step.

    Parabolas through neighbours: few of them where many would leave clearly more than noise, as
    where an arm touches something.
    """
    calm, calm_rate = (parabolas(values, _CALM_ROWS, order) for order in (0, 1))
    quick, quick_rate = (parabolas(values, _QUICK_ROWS, order) for order in (0, 1))
    missed = np.abs(values - calm)
    noise = MAD_TO_STD * np.median(missed, (0, 1))
    is_quick = maximum_filter1d((missed > _MISSED_STDS * noise).astype(int), _CALM_ROWS, axis=1) > 0
    return np.where(is_quick, quick, calm), np.where(is_quick, quick_rate, calm_rate)


def keep_moved_keypoints(
    observed: Observed,
    physics: Physics,
    states: np.ndarray,
    state_std: np.ndarray,
    unit: np.ndarray,
    fitted: np.ndarray,
) -> Observed:
    """Only the evidence of keypoints that something unknown moves.

    Those of a robot whose motion is known say nothing new, but their detection errors would count.
    `states`: (n, nq + nv) some; `state_std`: (2 nv,) 0 where states are known; `unit`: (N,)
    parameters in unit coordinates, of which those `fitted`, (P,) indices, are unknown.
    """
    here, changes = physics.predict(states, unit), _by_parameters(physics, states, unit, fitted)
    for tangent in np.diag(state_std)[state_std > 0]:
        elsewhere = physics.space.move(states, np.repeat(tangent[None], len(states), 0))
        change = np.abs(physics.predict(elsewhere, unit) - here).max(0)
        changes = np.maximum(changes, change)
    moved = np.any(changes.reshape(-1, 2) > _STILL_PX, axis=1)
    kept = observed.evidence.with_each(KeypointTracks, lambda tracks: tracks.only(moved))
    return replace(observed, evidence=kept)


def left_open(loop: OpenLoopReplay, keypoints: Keypoints, parameters: np.ndarray) -> np.ndarray:
    """(L,) bool: keypoints of what readings leave open, in a world of (N,) parameters.

    Those are of loose objects. They are all keypoints if anything else is not read, or if a
    parameter moves keypoints by itself, such as a camera's pose. Fewer are learnt sooner and
    better.
    """
    simulator, all_of_them = loop.physics.simulator, np.ones(len(keypoints), bool)
    if loop.unseen or not loop.measured.knows_all_but_objects:
        return all_of_them
    rng, worlds = np.random.default_rng(0), np.repeat(parameters[None], _KEYPOINT_WORLDS, 0)
    begun = simulator.begin(worlds, rng).states[:, 0]
    physics = Physics(simulator, keypoints.observe, begun[0])
    states, unit = physics.states(begun), physics.parameters.to_unit(parameters)
    if _by_parameters(physics, states, unit, loop.fitted).max(initial=0) > _STILL_PX:
        return all_of_them
    model = simulator.model
    loose = model.dof_treeid[loop.measured.is_loose]
    of_loose = np.isin(model.body_treeid[model.geom_bodyid], loose)
    return of_loose[keypoints.geoms]


def _by_parameters(
    physics: Physics, states: np.ndarray, unit: np.ndarray, nudged: np.ndarray
) -> np.ndarray:
    """(D,) largest change of predictions in (n, nq + nv) states, if `nudged` parameters change."""
    here, largest = physics.predict(states, unit), np.zeros(1)
    for parameter in nudged:
        other = unit.copy()
        other[parameter] += -_UNIT_STEP if unit[parameter] > 0.5 else _UNIT_STEP
        largest = np.maximum(largest, np.abs(physics.predict(states, other) - here).max(0))
    return np.broadcast_to(largest, here.shape[1:])


def without_readings(observed: Observed) -> Observed:
    """Only the evidence of pictures."""
    parts = tuple(p for p in observed.evidence.parts if not isinstance(p, JointReadings))
    late = observed.lateness.only(PICTURES) if observed.lateness else None
    return replace(observed, evidence=AllEvidence(parts), lateness=late)
