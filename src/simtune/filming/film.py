"""Films a world, in which some policy acts."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from simtune.config import RecordConfig
from simtune.errors import InputError
from simtune.evaluation.evaluate import load_trained
from simtune.experiment.settings import Settings
from simtune.experiment.training_experiment import TrainingExperiment
from simtune.filming.cameras import filming_whole, views_of, widths_of
from simtune.filming.checks import check_written
from simtune.observation import ObservationModel
from simtune.parameters.values_file import read_parameters
from simtune.progress import ReportProgress, silent
from simtune.random_streams import Purpose, stream
from simtune.real.observed import observed
from simtune.recordings import write_dataset
from simtune.simulation import (
    OPENGL_DM_CONTROL,
    Act,
    FrameStacker,
    Rollouts,
    Simulator,
    acting_late,
    on_pictures,
    random_actions,
)
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory

_ATTEMPTS = 10


def record(
    config: RecordConfig, report: ReportProgress = silent, settings: Settings | None = None
) -> Path:
    """Film episodes of one world, with actions of some policy; returns the folder.

    One episode is in memory at a time. Raises InputError for invalid input, with nothing written.
    """
    config.check()
    task = load_task(config.task)
    check_written(task)
    parameters = read_parameters(config.parameters, task.parameters)
    trained = _trained(config.policy, task, settings)
    size = config.image_size
    simulator = filming_whole(task).simulator(
        image_size=size,
        step_s=trained.learnt_in.simulator.step_s if trained else None,
        renderer=config.renderer,
        views=views_of(config, task),
        # OpenGL should look unlike the simulator, so it draws all that it can.
        quality=OPENGL_DM_CONTROL,
    )
    rng = stream(config.seed, Purpose.RECORD)
    world = parameters[None]
    num_steps = task.episode_steps
    seen = observed(replace(task, looks_at=None), None, is_simulated=True)  # all there is

    def play() -> Rollouts:
        act = _actor(config.policy, trained, simulator, world, num_steps, rng)
        return simulator.play(world, act, num_steps, rng, observe=seen.observe_beside())

    write_dataset(
        config.out,
        _film(config.episodes, simulator, play, seen, rng, report),
        action_names=task.action_columns or simulator.action_mapping.names,  # as read back
        robot_type=task.name,
        task=task.description,
        reading_names={sensor.name: sensor.column_names for sensor in task.sensors},
        widths=widths_of(task, simulator),
    )
    return config.out


def _film(
    num_episodes: int,
    simulator: Simulator,
    play: Callable[[], Rollouts],
    seen: ObservationModel,
    rng: np.random.Generator,
    report: ReportProgress,
) -> Iterator[Trajectory]:
    """Episodes one after the other; a diverged one is played again from another start."""
    for done in range(num_episodes):
        report("filming", done / num_episodes)
        attempts = (play().finished() for _ in range(_ATTEMPTS))
        rollouts = next(filter(len, attempts), None)
        if rollouts is None:
            raise RuntimeError(f"the physics diverged {_ATTEMPTS} times; see the parameters")
        (filmed,) = seen.record(simulator, rollouts, rng)
        written = {s.name: s.to_recorded(filmed.readings[s.name]) for s in seen.sensors}
        yield replace(filmed, readings=written)


def _trained(policy: str, task: Task, settings: Settings | None) -> TrainingExperiment | None:
    """The training of a policy that is one. Raises InputError if `task` has no such policy."""
    if policy == "scripted" and task.script is None:
        raise InputError(f"{task.name} has no script to act by: --policy random or a run")
    if policy in ("random", "scripted"):
        return None
    if not Path(policy).is_dir():
        raise InputError(
            "--policy must be random, scripted or a folder that `simtune train` wrote, got "
            f"{policy}"
        )
    trained = load_trained(Path(policy), settings=settings)
    if trained.task.content_hash != task.content_hash:
        raise InputError(
            f"--policy {policy} was trained for {trained.task.name}, not for {task.name}"
        )
    return trained


def _actor(
    policy: str,
    trained: TrainingExperiment | None,
    simulator: Simulator,
    world: np.ndarray,
    num_steps: int,
    rng: np.random.Generator,
) -> Act:
    """The next episode's actions in a (1, N) world: random, the script's, or a policy's.

    A policy sees pictures of its own, and acts as late as in the world that it was trained for.
    """
    if policy == "scripted":
        return simulator.follow_script(1)
    if trained is None:
        actions = random_actions(1, num_steps, simulator.action_mapping, rng)
        return lambda t, _: actions[:, t]
    trained.agent.begin_episodes()
    own = trained.learnt_in.simulator
    stacker = FrameStacker(own, world, num_steps, trained.schedule.num_stacked)
    return acting_late(on_pictures(simulator, stacker, trained.agent.act), trained.late_steps)
