"""`simtune check`, top to bottom."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.checking.conclusions import CLEAR
from simtune.checking.expected_precision import what_shows
from simtune.checking.extents import extents_px, small_in_pictures, unclear_of
from simtune.checking.image_size import choose_image_size
from simtune.checking.limits import joints_at_limits
from simtune.checking.mistakes.degrees import like_degrees
from simtune.checking.readings import reading_changes
from simtune.checking.recorded import Given, of_recordings
from simtune.checking.recording_warnings import too_short
from simtune.checking.replays import RecordedReplays
from simtune.checking.sensitive_starts import growth_warnings, sensitive
from simtune.checking.sensitivity.reading_changes import ReadingChanges
from simtune.checking.table import table
from simtune.checking.welds import turning_welds
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.names import DEFAULT_SEARCH
from simtune.observation import ObservationModel
from simtune.progress import ReportProgress, silent
from simtune.random_streams import Purpose, stream
from simtune.real.observed import observed
from simtune.run.files import plain
from simtune.tasks import Task, load_task

_EPISODES = 5
_REPLAYS_S = 180.0  # for what readings tell: fewer replays mislead
_ASKING_S = 60.0  # how well the best fit to pictures could tell
_NOT_ASKED = (
    "there was time to ask {:.0%} of the motion how well the best fit to pictures could tell; the "
    "rest is assumed to tell as much"
)


def carry_out(config: CheckConfig, report: ReportProgress) -> tuple[dict[str, Any], list[str]]:
    """The result as JSON, and the lines that show it: of checks, or of a search for a camera.

    Raises InputError for invalid input.
    """
    if config.camera_pose:
        from simtune.camera_pose import find_camera_pose, lines  # and Warp, which takes seconds

        camera = find_camera_pose(config, report)
        return camera, lines(camera, config.camera_pose)
    found = check(config, report)
    return found, table(found)


def check(config: CheckConfig, report: ReportProgress = silent) -> dict[str, Any]:
    """Sensitivity to each parameter, how well it can be found, facts of the recordings; JSON.

    Raises InputError for invalid input, such as a model all of whose episodes diverge.
    """
    config.check()
    task = load_task(config.task)
    observation = observed(task, config.observed, is_simulated=not config.real)
    size = choose_image_size(config, task, DEFAULT_SEARCH)
    facts: dict[str, Any] = {"task": task.name, "seed": config.seed, "image_size": size}
    facts["warnings"] = []  # keys are printed in this order
    if config.real:
        given = of_recordings(config, task, size, observation, report)
    else:
        given = _simulated(config, task, size, observation)
    facts |= given.facts
    simulator, actions = given.simulator, given.actions
    readings, seed = None, config.seed
    if observation.sensors:
        readings, facts["assumed"], more = _replayed(given, observation, seed, report)
        facts["warnings"] += [*more, *readings.left_out]
    asking, are_recorded = Budget(_ASKING_S, report, span=(0.7, 1.0)), bool(config.real)
    try:
        shown = what_shows(
            simulator, observation, actions, readings, seed, asking, are_recorded=are_recorded
        )
    except RuntimeError as error:
        raise _refused(error, facts["warnings"]) from error
    if shown.asked_share < 1:
        facts["warnings"].append(_NOT_ASKED.format(shown.asked_share))
    warnings = [*joints_at_limits(simulator, shown.states), *turning_welds(simulator, seed)]
    warnings += shown.elsewhere
    if observation.cameras:
        told = shown.concluded["parameters"].items()
        verdicts = {name: conclusion["verdict"] for name, conclusion in told}
        facts["extents_px"] = extents_px(simulator, shown.states, simulator.views)
        unclear = unclear_of(simulator, verdicts, CLEAR)
        warnings += small_in_pictures(facts["extents_px"], size, unclear, given.recorded_px)
    facts["warnings"] += [] if given.is_far else warnings  # which would follow from that
    facts |= {"episodes": len(actions), "steps": actions.shape[1], "step_s": simulator.step_s}
    return plain(facts | shown.concluded)


class _Replayed(NamedTuple):
    changes: ReadingChanges  # by each parameter
    assumed: str  # of errors
    warnings: list[str]


def _replayed(
    given: Given, observation: ObservationModel, seed: int, report: ReportProgress
) -> _Replayed:
    """Replays readings. Raises InputError if none can be replayed."""
    budget = Budget(_REPLAYS_S, report, span=(0.5, 0.7))
    budget.report("replaying readings")
    names = [f"episode {number}" for number in range(len(given.actions))]
    replays, warnings = None, list[str]()
    if given.read and not given.is_far:  # else all that follows from lengths would mislead
        names = given.facts["recordings"]["names"][: len(given.read.trajectories)]
        replays = RecordedReplays(given.simulator, observation, given.read.trajectories, names)
        warnings += replays.start_warnings()
    try:
        changes, assumed = reading_changes(
            given.simulator, observation, given.actions, given.read, seed, budget
        )
    except RuntimeError as error:
        more, of_sensors = list[str](), observation.sensors
        if given.read:
            more = like_degrees(given.simulator.model, of_sensors, given.read.readings.values)
        raise _refused(error, [*given.facts["warnings"], *warnings], more) from error
    if not given.is_far and not (given.read and given.read.misread):
        much = sensitive(changes.growth)
        touching = replays.contacts(much) if replays else None
        warnings += growth_warnings(changes.growth, names, touching)
    return _Replayed(changes, assumed, warnings)


def _refused(error: RuntimeError, before: list[str], more: Sequence[str] = ()) -> InputError:
    """Of a model that diverges, with what was found before, and `more`: it may say why."""
    return InputError("; ".join([*before, str(error), *more]))


def _simulated(config: CheckConfig, task: Task, size: int, observation: ObservationModel) -> Given:
    """Episodes that explore the task's simulator."""
    simulator = task.simulator(image_size=size, views=observation.views())
    num, rng = config.episodes or _EPISODES, stream(config.seed, Purpose.CHECKED_EPISODES)
    worlds = np.tile(task.parameters.nominal, (num, 1))
    act = simulator.explore(num, task.episode_steps, rng)
    actions = simulator.play(worlds, act, task.episode_steps, rng).actions
    kind = "scripted" if task.script else "random" if simulator.num_actions else "no"
    facts: dict[str, Any] = {"actions": kind}
    facts["warnings"] = too_short(task.episode_steps, are_filmed=bool(observation.cameras))
    return Given(simulator, actions, facts)
