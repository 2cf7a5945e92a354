"""The precision that `simtune check` expects, for comparison with a run's result."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from simtune.checking.begins_elsewhere import elsewhere_warnings, out_of_sight
from simtune.checking.conclusions import conclude
from simtune.checking.frictions import unfelt_frictions
from simtune.checking.mistakes.degrees import like_degrees
from simtune.checking.mistakes.misread import MOST_S
from simtune.checking.nominal import nominal_states
from simtune.checking.readings import look_at_servos, reading_changes
from simtune.fit.sensitivity import analyze
from simtune.observation import ObservationModel, joints_of
from simtune.run.files import plain
from simtune.simulation import AnySimulator, Simulator
from simtune.trajectory import Trajectory

_FIGURES = ("std", "std_percent", "interval_share")
_KEPT_KEYS = (*_FIGURES, *(f"{figure}_at_best" for figure in _FIGURES), "verdict", "note")


class ExpectedPrecision(NamedTuple):
    """What episodes and their readings could tell, near the nominal values."""

    parameters: dict[str, dict[str, Any]]  # {name: what the best fit could tell}; JSON
    warnings: list[str]  # on readings, such as those of another unit


def expected_precision(
    simulator: AnySimulator,
    seen: ObservationModel,
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
        if seen.sensors:
            read = look_at_servos(real, simulator, seen, names, most_s)
            warnings += read.warnings + read.misread + read.beyond_ranges
            readings, _ = reading_changes(simulator, seen, actions, read, seed)
        sensitivity = analyze(simulator, actions, seed, seen, readings)
    except RuntimeError:  # every episode diverged
        if read:
            sensors, values = joints_of(seen.sensors), read.readings.values
            warnings += like_degrees(simulator.model, sensors, values)
        return ExpectedPrecision({}, warnings)
    states, hidden = nominal_states(simulator, actions, seed), out_of_sight(simulator, seed)
    reasons = unfelt_frictions(simulator, states) | hidden
    said = conclude(simulator.space, sensitivity, reasons)["parameters"]
    warnings += elsewhere_warnings(simulator, states, hidden, said, seed, are_recorded=bool(names))
    kept = plain({name: {k: p[k] for k in _KEPT_KEYS if k in p} for name, p in said.items()})
    return ExpectedPrecision(kept, warnings)
