"""`simtune record`: film a task's world into a LeRobotDataset v3."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from simtune.config import RecordConfig
from simtune.errors import InputError
from simtune.evaluate import load_trained
from simtune.experiment.settings import Settings
from simtune.experiment.training_experiment import TrainingExperiment
from simtune.progress import ReportProgress, silent
from simtune.real.choose import read_parameters
from simtune.recordings import write_dataset
from simtune.simulation import (
    OPENGL_DM_CONTROL,
    Act,
    FrameStacker,
    Simulator,
    on_pictures,
    random_actions,
)
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory


def record(
    config: RecordConfig, report: ReportProgress = silent, settings: Settings | None = None
) -> Path:
    """Film episodes of one world, and of what acts in it; returns the folder.

    One episode is in memory at a time. Raises InputError for what cannot be used, with nothing
    written.
    """
    config.check()
    task = load_task(config.task)
    parameters = read_parameters(config.parameters, task.parameters)
    trained = _trained(config.policy, task, settings)
    simulator = task.simulator(
        image_size=config.image_size,
        step_s=trained.environment.simulator.step_s if trained else None,
        renderer=config.renderer,
        # OpenGL is there to look unlike the simulator, so it draws all that it can.
        quality=OPENGL_DM_CONTROL,
    )
    rng = np.random.default_rng(config.seed)
    actor = _Actor(config.policy, trained, task.episode_steps, simulator, rng)
    write_dataset(
        config.out,
        _film(config, simulator, task, parameters[None], actor, report),
        action_names=simulator.action_mapping.names,
        robot_type=task.name,
        task=task.description,
    )
    return config.out


_ATTEMPTS = 10


def _film(
    config: RecordConfig,
    simulator: Simulator,
    task: Task,
    world: np.ndarray,
    actor: "_Actor",
    report: ReportProgress,
) -> Iterator[Trajectory]:
    """Episodes one after the other; one that diverges is played again from another start."""
    for done in range(config.episodes):
        report("filming", done / config.episodes)
        for _ in range(_ATTEMPTS):
            act = actor.begin(world)
            rollouts = simulator.play(world, act, task.episode_steps, actor.rng)
            if rollouts.lengths[0] == task.episode_steps:
                break
        else:
            raise RuntimeError(f"the physics diverged {_ATTEMPTS} times; see the parameters")
        frames = simulator.film(rollouts)[0]
        yield Trajectory(frames, rollouts.actions[0].astype(np.float32), simulator.step_s)


def _trained(policy: str, task: Task, settings: Settings | None) -> TrainingExperiment | None:
    """The training of a policy that is one. Raises InputError where `task` has no such policy."""
    if policy == "scripted" and task.script is None:
        raise InputError(f"{task.name} has no script to act by: --policy random or a run")
    if policy in ("random", "scripted"):
        return None
    trained = load_trained(Path(policy), settings=settings)
    if trained.task.content_hash != task.content_hash:
        raise InputError(
            f"--policy {policy} was trained for {trained.task.name}, not for {task.name}"
        )
    return trained


class _Actor:
    """Random actions, the task's script, or a trained policy, which sees pictures of its own."""

    def __init__(
        self,
        policy: str,
        trained: TrainingExperiment | None,
        num_steps: int,
        simulator: Simulator,
        rng: np.random.Generator,
    ):
        self.rng = rng
        self._steps, self._simulator, self._trained = num_steps, simulator, trained
        self._is_scripted = policy == "scripted"

    def begin(self, world: np.ndarray) -> Act:
        """What acts in the next episode of a (1, N) world."""
        if self._is_scripted:
            return self._simulator.follow_script(len(world))
        if self._trained is None:
            mapping = self._simulator.action_mapping
            actions = random_actions(1, self._steps, mapping, self.rng)
            return lambda t, _: actions[:, t]
        agent, stacked = self._trained.agent, self._trained.schedule.num_stacked
        stacker = FrameStacker(self._trained.environment.simulator, world, self._steps, stacked)
        return on_pictures(self._simulator, stacker, agent.act)
