"""What `simtune check` predicts, for comparison with a run's result."""

from typing import Any

import numpy as np

from simtune.checking.conclusions import conclude
from simtune.checking.frictions import unfelt_frictions
from simtune.checking.nominal import nominal_states
from simtune.checking.readings import look_at_servos, reading_changes
from simtune.fit.sensitivity import analyze
from simtune.observation import ObservationModel
from simtune.run.files import plain
from simtune.simulation import AnySimulator, Simulator
from simtune.trajectory import Trajectory

_KEPT = ("std", "std_percent", "interval_share", "verdict", "note")


def promises(
    simulator: AnySimulator, seen: ObservationModel, real: list[Trajectory], seed: int
) -> dict[str, dict[str, Any]]:
    """{parameter: what the best fit to such episodes could tell, near the nominal values}; JSON.

    Empty without a MuJoCo model, or if all nominal worlds diverge.
    """
    if not isinstance(simulator, Simulator):
        return {}
    steps, readings = min(map(len, real)), None
    actions = np.stack([trajectory.actions[:steps] for trajectory in real])
    try:
        if seen.sensors:
            read = look_at_servos(real, simulator, seen)
            readings, _ = reading_changes(simulator, seen, actions, read, seed)
        sensitivity = analyze(simulator, actions, seed, seen, readings)
    except RuntimeError:  # every episode diverged
        return {}
    reasons = unfelt_frictions(simulator, nominal_states(simulator, actions, seed))
    said = conclude(simulator.space, sensitivity, reasons)["parameters"]
    return plain({name: {k: p[k] for k in _KEPT if k in p} for name, p in said.items()})
