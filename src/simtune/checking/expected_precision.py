"""What episodes could tell of each parameter: for `check`, and beside a run's result."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from simtune.budget import NO_LIMIT, Budget
from simtune.checking.begins_elsewhere import elsewhere_warnings, out_of_sight
from simtune.checking.conclusions import conclude_on_parameters
from simtune.checking.frictions import unfelt_frictions
from simtune.checking.mistakes.degrees import like_degrees
from simtune.checking.mistakes.misread import MOST_S
from simtune.checking.nominal import nominal_states
from simtune.checking.readings import look_at_servos, reading_changes
from simtune.checking.sensitivity.parameters import analyze
from simtune.checking.sensitivity.reading_changes import ReadingChanges
from simtune.observation import ObservationModel
from simtune.run.files import plain
from simtune.simulation import AnySimulator, Simulator
from simtune.trajectory import Trajectory

_FIGURES = ("std", "std_percent", "interval_share")
_KEPT_KEYS = (*_FIGURES, *(f"{figure}_at_best" for figure in _FIGURES), "verdict", "note")


class WhatShows(NamedTuple):
    """Of episodes near the nominal parameters."""

    concluded: dict[str, Any]  # as `conclude_on_parameters` gives it
    asked_share: float  # see `CameraChanges`
    states: np.ndarray  # (E, T + 1, S) of the same actions in nominal worlds
    elsewhere: list[str]  # warnings of things that begin elsewhere than on film


def what_shows(
    simulator: Simulator,
    observation: ObservationModel,
    actions: np.ndarray,
    readings: ReadingChanges | None,
    seed: int,
    budget: Budget = NO_LIMIT,
    *,
    are_recorded: bool,
) -> WhatShows:
    """In episodes of (E, T, A) actions; `readings`, `budget`: see `analyze`.

    Raises RuntimeError if every episode diverges.
    """
    sensitivity = analyze(simulator, actions, seed, observation, readings, budget)
    states, hidden = nominal_states(simulator, actions, seed), out_of_sight(simulator, seed)
    reasons = unfelt_frictions(simulator, states) | hidden
    concluded = conclude_on_parameters(simulator.space, sensitivity, reasons)
    elsewhere = elsewhere_warnings(
        simulator, states, hidden, concluded["parameters"], seed, are_recorded=are_recorded
    )
    return WhatShows(concluded, sensitivity.pictures.asked_share, states, elsewhere)


class ExpectedPrecision(NamedTuple):
    """What episodes and their readings could tell, near the nominal values."""

    parameters: dict[str, dict[str, Any]]  # {name: what the best fit could tell}; JSON
    warnings: list[str]  # on readings, such as those of another unit


def expected_precision(
    simulator: AnySimulator,
    observation: ObservationModel,
    real: list[Trajectory],
    seed: int,
    names: Sequence[str] = (),
    most_s: float = MOST_S,
) -> ExpectedPrecision:
    """Of episodes with these names, which warnings give; without names they are simulated.

    `most_s`: seconds for mistakes in readings that short replays tell (`misread`).
    Nothing without a MuJoCo model; no parameters if all nominal worlds diverge.
    """
    warnings = list[str]()
    if not isinstance(simulator, Simulator):
        return ExpectedPrecision({}, warnings)
    readings = read = None
    steps = min(map(len, real))
    actions = np.stack([trajectory.actions[:steps] for trajectory in real])
    try:
        if observation.sensors:
            read = look_at_servos(real, simulator, observation, names, most_s)
            warnings += read.warnings + read.misread + read.beyond_ranges
            readings, _ = reading_changes(simulator, observation, actions, read, seed)
        shown = what_shows(
            simulator, observation, actions, readings, seed, are_recorded=bool(names)
        )
    except RuntimeError:  # every episode diverged
        if read:
            sensors, values = observation.sensors, read.readings.values
            warnings += like_degrees(simulator.model, sensors, values)
        return ExpectedPrecision({}, warnings)
    said = shown.concluded["parameters"]
    kept = plain({name: {k: p[k] for k in _KEPT_KEYS if k in p} for name, p in said.items()})
    return ExpectedPrecision(kept, warnings + shown.elsewhere)
