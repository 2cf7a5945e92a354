"""Joint readings in `check`: how servos follow, and what parameters change in them."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from simtune.budget import NO_LIMIT, Budget
from simtune.checking.doubt import grouped
from simtune.checking.mistakes.joint_ranges import CERTAINLY_WIDER, WIDER, beyond_ranges
from simtune.checking.mistakes.misread import MOST_S, misread
from simtune.checking.reading_errors import of_recorded, of_simulated
from simtune.checking.sensitivity.parameters import one_by_one, where_analyzed
from simtune.checking.sensitivity.reading_changes import ReadingChanges, ReplayedReadings
from simtune.checking.servos.fit import ServoResponse
from simtune.checking.servos.following import Watched
from simtune.checking.servos.gains import gains_to_write
from simtune.checking.servos.look import SeenJoint, look_at_all
from simtune.checking.servos.lost import missing
from simtune.checking.servos.picture import Curve
from simtune.checking.servos.watch import watched
from simtune.fit import FEWEST_STEPS, Readings
from simtune.observation import ObservationModel
from simtune.real.recorded import read_episode
from simtune.recordings import Dataset
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory


class ReadEpisodes(NamedTuple):
    """Recorded readings, and how their joints follow commands."""

    trajectories: list[Trajectory]  # without pictures
    readings: Readings  # theirs
    servos: dict[str, ServoResponse]  # by reading, in its unit
    curves: dict[str, Curve]  # of the first episode that is long enough
    facts: dict[str, Any]  # JSON
    warnings: list[str]
    misread: list[str]  # warnings of signs, columns, units or zeros that are not the model's
    beyond_ranges: list[str]  # ... of readings that span more than the model's joints can


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
    most_s: float = MOST_S,
) -> ReadEpisodes:
    """How the joints of episodes, with these names, follow their commands.

    `most_s`: seconds in which signs, columns, units and zeros are looked for that are not the
    model's (`misread`).
    """
    sensors = observation.sensors
    readings = Readings.of(trajectories, sensors)
    read = readings.values
    found = missing(observation.reading_labels, read, [len(t) for t in trajectories], names)
    joints, lost = watched(trajectories, simulator, observation, read, names)
    is_long = any(len(t) >= FEWEST_STEPS for t in trajectories)
    seen = look_at_all(joints, sensors) if is_long else [None] * len(joints)
    by_name = {joint.name: look for joint, look in zip(joints, seen, strict=True) if joint and look}
    of_speeds = {joint.name for joint in joints if joint and joint.positions}
    found += lost + grouped(doubt for look in by_name.values() for doubt in look.doubts)
    found += gains_to_write(sensors, [look.misread_by if look else None for look in seen])
    wider = [_wider(joint, look) for joint, look in zip(joints, seen, strict=True)]
    return ReadEpisodes(
        trajectories,
        readings,
        servos={name: look.servo for name, look in by_name.items() if name not in of_speeds},
        curves={name: look.curve for name, look in by_name.items()},
        facts={name: look.facts() for name, look in by_name.items()},
        warnings=found,
        misread=misread(readings, simulator, observation, most_s),
        beyond_ranges=beyond_ranges(simulator.model, sensors, read, wider),
    )


def _wider(joint: Watched | None, seen: SeenJoint | None) -> float:
    """Than a joint's range: readings that span so much are told of."""
    if seen and seen.doubts:
        return math.inf  # nothing said twice
    return WIDER if joint is None else CERTAINLY_WIDER


def reading_changes(
    simulator: Simulator,
    observation: ObservationModel,
    actions: np.ndarray,
    recorded: ReadEpisodes | None,
    seed: int,
    budget: Budget = NO_LIMIT,
) -> tuple[ReadingChanges, str]:
    """For every parameter, in episodes of (E, T, A) actions; and the assumption on errors.

    `budget`: see `ReplayedReadings`.
    """
    sensors = observation.sensors
    nominal = where_analyzed(simulator.space)
    readings = recorded.readings if recorded else None
    replayed = ReplayedReadings(simulator, observation, nominal, actions, readings, seed, budget)
    if recorded:
        labels, step_s = observation.reading_labels, simulator.step_s
        errors = of_recorded(recorded.readings.values, recorded.servos, labels, sensors, step_s)
    else:
        errors = of_simulated(sensors)
    changed = one_by_one(simulator.space, nominal)
    return replayed.changes(changed, errors.noise, errors.at_best), errors.assumed
