"""`simtune check`, top to bottom."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.checking import sensitive_starts
from simtune.checking.begins_elsewhere import elsewhere_warnings, out_of_sight
from simtune.checking.conclusions import CLEAR, conclude
from simtune.checking.extents import extents_px, small, unclear_of
from simtune.checking.frictions import unfelt_frictions
from simtune.checking.image_size import choose_image_size
from simtune.checking.limits import joints_at_limits
from simtune.checking.mistakes.degrees import like_degrees
from simtune.checking.mistakes.misread import MOST_S
from simtune.checking.nominal import nominal_states
from simtune.checking.readings import reading_changes
from simtune.checking.recorded import Given, of_recordings
from simtune.checking.recording_warnings import too_short
from simtune.checking.replays import RecordedReplays
from simtune.checking.welds import turning_welds
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.fit.readings.sensitivity import ReadingChanges
from simtune.fit.sensitivity import analyze
from simtune.observation import ObservationModel, joints_of
from simtune.progress import ReportProgress, silent
from simtune.random_streams import Purpose, stream
from simtune.real.observed import observed
from simtune.run.files import plain
from simtune.tasks import Task, load_task

_EPISODES = 5
_REPLAYS_S = 180.0  # for what readings tell: fewer replays mislead
_NOT_ASKED = (
    "there was time to ask {:.0%} of the motion how well the best fit to pictures could tell; the "
    "rest is assumed to tell as much"
)


def check(config: CheckConfig, report: ReportProgress = silent) -> dict[str, Any]:
    """Sensitivity to each parameter, how well it can be found, facts of the recordings; JSON.

    Raises InputError for invalid input, such as a model all of whose episodes diverge.
    """
    config.check()
    task = load_task(config.task)
    seen = observed(task, config.observed, is_simulated=not config.real)
    size = choose_image_size(config, task, "posterior")
    facts: dict[str, Any] = {"task": task.name, "seed": config.seed, "image_size": size}
    facts["warnings"] = []  # keys are printed in this order
    if config.real:
        given = of_recordings(config, task, size, seen, report)
    else:
        given = _simulated(config, task, size, seen)
    facts |= given.facts
    simulator, actions = given.simulator, given.actions
    readings = None
    if seen.sensors:
        readings, facts["assumed"], more = _replayed(given, seen, config.seed, report)
        facts["warnings"] += [*more, *readings.left_out]
    asking = Budget(MOST_S, report, span=(0.7, 1.0))
    try:
        sensitivity = analyze(simulator, actions, config.seed, seen, readings, asking)
    except RuntimeError as error:
        raise _refused(error, facts["warnings"]) from error
    if sensitivity.asked_share < 1:
        facts["warnings"].append(_NOT_ASKED.format(sensitivity.asked_share))
    states = nominal_states(simulator, actions, config.seed)
    hidden = out_of_sight(simulator, config.seed)
    reasons = unfelt_frictions(simulator, states) | hidden
    concluded = conclude(task.parameters, sensitivity, reasons)
    warnings = [*joints_at_limits(simulator, states), *turning_welds(simulator, config.seed)]
    warnings += elsewhere_warnings(
        simulator,
        states,
        hidden,
        concluded["parameters"],
        config.seed,
        are_recorded=bool(config.real),
    )
    if seen.cameras:
        verdicts = {name: its["verdict"] for name, its in concluded["parameters"].items()}
        facts["extents_px"] = extents_px(simulator, states, simulator.views)
        unclear = unclear_of(simulator, verdicts, CLEAR)
        warnings += small(facts["extents_px"], size, unclear, given.recorded_px)
    facts["warnings"] += [] if given.is_far else warnings  # which would follow from that
    facts |= {"episodes": len(actions), "steps": actions.shape[1], "step_s": simulator.step_s}
    return plain(facts | concluded)


class _Replayed(NamedTuple):
    changes: ReadingChanges  # by each parameter
    assumed: str  # of errors
    warnings: list[str]


def _replayed(given: Given, seen: ObservationModel, seed: int, report: ReportProgress) -> _Replayed:
    """Replays readings. Raises InputError if none can be replayed."""
    budget = Budget(_REPLAYS_S, report, span=(0.5, 0.7))
    budget.report("replaying readings")
    names = [f"episode {number}" for number in range(len(given.actions))]
    replays, warnings = None, list[str]()
    if given.read and not given.is_far:  # else all that follows from lengths would mislead
        names = given.facts["recordings"]["names"][: len(given.read.trajectories)]
        replays = RecordedReplays(given.simulator, seen, given.read.trajectories, names)
        warnings += replays.start_warnings()
    try:
        changes, assumed = reading_changes(
            given.simulator, seen, given.actions, given.read, seed, budget
        )
    except RuntimeError as error:
        more, of_sensors = list[str](), joints_of(seen.sensors)
        if given.read:
            more = like_degrees(given.simulator.model, of_sensors, given.read.readings.values)
        raise _refused(error, [*given.facts["warnings"], *warnings], more) from error
    if not given.is_far and not (given.read and given.read.misread):
        much = sensitive_starts.sensitive(changes.growth)
        touching = replays.contacts(much) if replays else None
        warnings += sensitive_starts.warnings(changes.growth, names, touching)
    return _Replayed(changes, assumed, warnings)


def _refused(error: RuntimeError, before: list[str], more: Sequence[str] = ()) -> InputError:
    """Of a model that diverges, with what was found before, and `more`: it may say why."""
    return InputError("; ".join([*before, str(error), *more]))


def _simulated(config: CheckConfig, task: Task, size: int, seen: ObservationModel) -> Given:
    """Episodes that explore the task's simulator."""
    simulator = task.simulator(image_size=size, views=seen.views())
    num, rng = config.episodes or _EPISODES, stream(config.seed, Purpose.CHECKED_EPISODES)
    worlds = np.tile(task.parameters.nominal, (num, 1))
    act = simulator.explore(num, task.episode_steps, rng)
    actions = simulator.play(worlds, act, task.episode_steps, rng).actions
    kind = "scripted" if task.script else "random" if simulator.num_actions else "no"
    facts: dict[str, Any] = {"actions": kind}
    facts["warnings"] = too_short(task.episode_steps, are_filmed=bool(seen.cameras))
    return Given(simulator, actions, facts)
