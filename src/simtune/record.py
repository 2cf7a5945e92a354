"""`simtune record`: film a task's world into a LeRobotDataset v3."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from simtune.cameras.lens import Lens
from simtune.cameras.rectify import SHAPE
from simtune.cameras.views import View
from simtune.config import RecordConfig
from simtune.errors import InputError
from simtune.evaluation.evaluate import load_trained
from simtune.experiment.settings import Settings
from simtune.experiment.training_experiment import TrainingExperiment
from simtune.observation import ObservationModel
from simtune.progress import ReportProgress, silent
from simtune.real.choose import observed, read_parameters
from simtune.recordings import write_dataset
from simtune.recordings.lerobot.layout import IMAGES_PREFIX, STATE
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


def record(
    config: RecordConfig, report: ReportProgress = silent, settings: Settings | None = None
) -> Path:
    """Film episodes of one world, with actions of some policy; returns the folder.

    One episode is in memory at a time. Raises InputError for invalid input, with nothing written.
    """
    config.check()
    task = load_task(config.task)
    _check_written(task)
    parameters = read_parameters(config.parameters, task.parameters)
    trained = _trained(config.policy, task, settings)
    size = config.image_size
    simulator = filming_whole(task).simulator(
        image_size=size,
        step_s=trained.environment.simulator.step_s if trained else None,
        renderer=config.renderer,
        views=_views(config, task),
        # OpenGL should look unlike the simulator, so it draws all that it can.
        quality=OPENGL_DM_CONTROL,
    )
    rng, world, num_steps = np.random.default_rng(config.seed), parameters[None], task.episode_steps
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
        widths=_widths(task, simulator),
    )
    return config.out


def _check_written(task: Task) -> None:
    """Raises InputError for what could not be written, or would be read back otherwise."""
    if not task.load_actions().names:
        raise InputError(
            f"{task.name} has no actions, and a LeRobotDataset needs some: give the model actuators"
        )
    late = [part.name for part in (*task.cameras, *task.sensors) if part.latency_s]
    if late:
        raise InputError(
            f"{late[0]} of {task.name} has a latency_s, and what simtune films is in time: record "
            "with a copy of the tuning file without it"
        )
    _check_columns(task)


def _check_columns(task: Task) -> None:
    """Raises InputError if a reading would not be found again by its column's name."""
    names = [name for sensor in task.sensors for name in sensor.column_names]
    if doubled := [name for i, name in enumerate(names) if name in names[:i]]:
        raise InputError(
            f"two sensors of {task.name} would both be written as {doubled[0]!r}; name their "
            "columns one by one: columns = [...]"
        )
    for i, name in enumerate(names):
        if name.startswith(f"{STATE}[") and name != f"{STATE}[{i}]":
            raise InputError(
                f"{name!r} of {task.name} would be written as number {i} of {STATE!r}; list the "
                "columns in their order, from 0 on, or give them names"
            )
    for sensor in task.sensors:
        first = sensor.columns[0]
        reads_all = len(sensor.columns) == 1 and (sensor.size > 1 or first == STATE)
        if reads_all and (first != STATE or len(task.sensors) > 1):
            raise InputError(
                f"sensor {sensor.name} of {task.name} reads all of {first!r}, and simtune writes "
                f"all sensors side by side into {STATE!r}; name their columns one by one"
            )


def _views(config: RecordConfig, task: Task) -> list[View]:
    """What the cameras film, before the pictures that the tuning file names as backgrounds.

    Raises InputError like `_aspect`, and for a picture that cannot be drawn.
    """
    size, views = config.image_size, []
    for footage in task.cameras:
        view = View(footage.camera, _aspect(config, footage.lens))
        # All of the picture: readers look at the region, see `filming_whole`.
        plate = replace(footage, lens=None).picture((size, view.width(size)))
        if plate is not None and config.renderer == "opengl":
            raise InputError(
                f"{footage.background}: OpenGL cannot draw a background picture: leave --renderer "
                "opengl out, or record with a copy of the tuning file without background"
            )
        views.append(replace(view, plate=plate))
    return views


def _aspect(config: RecordConfig, lens: Lens | None) -> float:
    """Width over height of what is filmed, an even number of pixels wide.

    Raises InputError if these are not of a lens's shape, and would not be read as its pictures.
    """
    size = config.image_size
    if lens is None:
        return (config.width or size) / size
    width = config.width or 2 * round(size * lens.width / lens.height / 2)
    if abs(width / size - lens.width / lens.height) > SHAPE:
        raise InputError(
            f"pictures of {width}×{size} pixels are of another shape than those that the tuning "
            f"file names, {lens.width}×{lens.height}; leave --width out, and give an --image-size "
            "of 128 or more"
        )
    return width / size


def filming_whole(task: Task) -> Task:
    """The same task with cameras that see whole pictures, not only regions.

    So readers apply the region once. Raises InputError for a lens that distorts or looks aside:
    pictures are drawn through pinholes.
    """
    lenses = {footage.camera: footage.lens for footage in task.cameras if footage.lens}
    for name, lens in lenses.items():
        if not lens.is_pinhole:
            raise InputError(
                f"camera {name} of {task.name} has a lens, and pictures are drawn without one: "
                "record with a copy of the tuning file without intrinsics, distortion, calibration"
            )

    def load_spec() -> mujoco.MjSpec:
        spec = task.load_spec()
        for name, lens in lenses.items():
            given = spec.camera(name)
            given.quat, given.fovy = lens.from_region(given.quat), lens.whole_fovy_deg
        return spec

    return replace(task, load_spec=load_spec) if lenses else task


def _widths(task: Task, simulator: Simulator) -> dict[str, int] | None:
    """{camera: pixels}, by the names under which they are read; None if one has no such name."""
    names = [footage.key or footage.name for footage in task.cameras]
    if len(names) == 1 and task.cameras[0].key is None:
        return None
    names = [name.removeprefix(IMAGES_PREFIX) for name in names]
    return dict(zip(names, simulator.widths, strict=True))


_ATTEMPTS = 10


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
    own = trained.environment.simulator
    stacker = FrameStacker(own, world, num_steps, trained.schedule.num_stacked)
    return acting_late(on_pictures(simulator, stacker, trained.agent.act), trained.late_steps)
