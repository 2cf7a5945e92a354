"""Joint readings in `check`: how servos follow, and what parameters change in them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from simtune.checking.servos.commands import commands_of, servos_of
from simtune.checking.servos.doubts import Watched, doubts
from simtune.checking.servos.fit import Servo, fit_servo, predict
from simtune.checking.servos.joint_ranges import CERTAINLY_WIDER, WIDER, beyond_ranges
from simtune.checking.servos.lost import missing, without_lost_packets
from simtune.checking.servos.picture import Curve
from simtune.checking.servos.play import find_play
from simtune.fit import Readings
from simtune.fit.readings.sensitivity import ReadingChanges, ReplayedReadings
from simtune.fit.sensitivity import one_by_one, where_analyzed
from simtune.observation import ObservationModel, joints_of, units_of, usual_noise
from simtune.real.recorded import read_episode
from simtune.recordings import Dataset
from simtune.run.files import plain
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory

_CORRELATED_S = 0.5  # correlation time of a reading's residuals: model errors, not noise
_LEFT = 0.03  # of a reading's travel: assumed residuals of a fit if no servo gives them
_FEWEST_STEPS = 8
_ASSUMED_OF_RECORDINGS = (
    f"as if what a lag and an offset leave of each reading, for {_CORRELATED_S:g} s at a "
    "time, were left by the best fit, too"
)
_ASSUMED = "as if readings had no errors but their sensors' noise"


class ReadEpisodes(NamedTuple):
    """Recorded readings, and how their joints follow commands."""

    trajectories: list[Trajectory]  # without pictures
    servos: dict[str, Servo]  # by reading
    curves: dict[str, Curve]  # of the first episode that is long enough
    facts: dict[str, Any]  # JSON
    warnings: list[str]


def read_episodes(
    dataset: Dataset, num: int, simulator: Simulator, observation: ObservationModel
) -> ReadEpisodes:
    """The first `num` episodes. Raises InputError if one is unsound."""
    trajectories = [
        read_episode(dataset, episode, observation, pictures=False) for episode in range(num)
    ]
    return look_at_servos(trajectories, simulator, observation, dataset.episodes)


def look_at_servos(
    trajectories: list[Trajectory],
    simulator: Simulator,
    observation: ObservationModel,
    names: Sequence[str] = (),
) -> ReadEpisodes:
    """How the joints of episodes, with these names, follow their commands."""
    servos, plays, found = dict[str, Servo](), dict[str, float | None](), list[str]()
    curves = dict[str, Curve]()
    sensors = joints_of(observation.sensors)
    labels, units = observation.reading_labels, units_of(sensors)
    followed = servos_of(simulator, sensors)
    commands = commands_of(simulator, sensors, trajectories) if any(followed) else []
    read = Readings.of(trajectories, sensors).values
    noise = usual_noise(sensors)
    wider = [WIDER if servo is None else CERTAINLY_WIDER for servo in followed]
    found += missing(labels, read, [len(t) for t in trajectories], names)
    long = [e for e, c in enumerate(commands) if len(c) >= _FEWEST_STEPS]
    for column, command_of in enumerate(followed):
        if command_of is None or not long:
            continue
        asked = [command_of.targets(c) for c in commands]
        measured = [read[e, : len(c) + 1, column] for e, c in enumerate(commands)]
        label, unit = labels[column], units[column]
        measured, lost = without_lost_packets(label, unit, asked, measured, noise[column], names)
        fitted = [asked[e] for e in long], [measured[e] for e in long]
        servo = fit_servo(*fitted, simulator.step_s)
        play = find_play(servo, *fitted, simulator.step_s)
        servos[label], plays[label] = servo, play.width if play.is_clear(servo.noise) else None
        joint = Watched(label, unit, asked, measured, servo, simulator.step_s, names)
        if doubtful := doubts(joint):
            wider[column] = math.inf  # nothing said twice
        found += lost + doubtful
        command = asked[long[0]]
        (predicted,) = predict(servo, [command], simulator.step_s)
        curves[label] = Curve(unit, command, measured[long[0]], predicted, servo)
    found += beyond_ranges(simulator.model, sensors, read, wider)
    facts = {
        label: plain({"unit": units[labels.index(label)], **asdict(servo), "play": plays[label]})
        for label, servo in servos.items()
    }
    return ReadEpisodes(trajectories, servos, curves, facts, found)


def reading_changes(
    simulator: Simulator,
    observation: ObservationModel,
    actions: np.ndarray,
    recorded: ReadEpisodes | None,
    seed: int,
) -> tuple[ReadingChanges, str]:
    """For every parameter, in episodes of (E, T, A) actions; and the assumption on errors."""
    sensors = joints_of(observation.sensors)
    nominal = where_analyzed(simulator.space)
    readings = Readings.of(recorded.trajectories, sensors) if recorded else None
    replayed = ReplayedReadings(simulator, observation, nominal, actions, readings, seed)
    noise = usual_noise(sensors)
    if recorded and readings:
        left = _left(readings.values, recorded.servos, observation.reading_labels)
        noise = np.maximum(noise, left) * np.sqrt(max(1.0, _CORRELATED_S / simulator.step_s))
    changes = replayed.changes(one_by_one(simulator.space, nominal), noise)
    return changes, _ASSUMED_OF_RECORDINGS if recorded else _ASSUMED


def _left(values: np.ndarray, servos: Mapping[str, Servo], labels: Sequence[str]) -> np.ndarray:
    """(D,) root mean square residuals that the best fit may leave of (E, T + 1, D) readings."""
    flat = values.reshape(-1, values.shape[-1])
    usual = _LEFT * np.ptp(np.nanpercentile(flat, (1, 99), axis=0), axis=0)
    known = np.array([servos[n].filtered_rms if n in servos else np.nan for n in labels])
    return np.where(np.isfinite(known), known, usual)
