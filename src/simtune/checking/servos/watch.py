"""Joints that servos move: what they are asked to do, and what was read of them."""

from collections.abc import Sequence

import numpy as np

from simtune.checking.servos.commands import commands_of, servos_of
from simtune.checking.servos.following import Watched
from simtune.checking.servos.lost import without_lost_packets
from simtune.checking.servos.speeds import beside_speeds
from simtune.observation import ObservationModel, assumed_noise, units_of
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory


def watched(
    trajectories: list[Trajectory],
    simulator: Simulator,
    observation: ObservationModel,
    read: np.ndarray,
    names: Sequence[str],
) -> tuple[list[Watched | None], list[str]]:
    """For each of (E, T + 1, D) readings the joint that actions command, or None.

    Without lost packets, of which the warnings are. `names` are the episodes'.
    """
    sensors, step_s = observation.sensors, simulator.step_s
    servos = servos_of(simulator, sensors)
    commands = commands_of(simulator, sensors, trajectories) if any(servos) else []
    found: list[Watched | None] = [None] * len(servos)
    of_speed, warnings = dict[int, Watched](), list[str]()
    noise, units = assumed_noise(sensors), units_of(sensors)
    for column, servo in enumerate(servos):
        if servo is None:
            continue
        asked = travels = [servo.targets(controls) for controls in commands]
        reads_places = servo.of_speed and not units[column].endswith("/s")
        if reads_places:
            travels = [step_s * np.cumsum(speeds) for speeds in asked]
        measured = [read[e, : len(c) + 1, column] for e, c in enumerate(commands)]
        name, unit = observation.reading_labels[column], units[column]
        kept, lost = without_lost_packets(name, unit, travels, measured, noise[column], names)
        warnings += lost
        joint = Watched(name, unit, asked, kept, step_s, names)
        found[column] = joint
        if reads_places:
            of_speed[column] = joint
    for column, joint in zip(of_speed, beside_speeds(list(of_speed.values())), strict=True):
        found[column] = joint
    return found, warnings
