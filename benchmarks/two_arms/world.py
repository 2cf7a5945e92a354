"""A world of the two arms that differs from the model, and recordings of it."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from simtune.cameras.views import View
from simtune.filming import filming_whole
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.recordings import write_dataset
from simtune.simulation import OPENGL_DM_CONTROL
from simtune.tasks import Task
from simtune.trajectory import Trajectory
from two_arms.pushes import Operator

_FACTOR = 2.0  # a parameter of motion is as many times too high or too low at most
_COLOURS = (0.15, 0.55)  # brighter ones are white under the scene's lights: no film tells them
_OFFSET_RAD = 0.02  # of an encoder, at most
_DELAY_STEPS = 1  # by which the arms follow late
_PIXELS = 480  # of a real camera


@dataclass(frozen=True)
class World:
    """What a benchmark knows and simtune does not."""

    parameters: np.ndarray  # (N,)
    offsets: np.ndarray  # (D,) measured − true

    @classmethod
    def draw(cls, space: ParameterSpace, num_joints: int, seed: int) -> "World":
        """The world of a seed."""
        rng = np.random.default_rng((seed, 22))
        factors = _FACTOR ** rng.uniform(-1, 1, len(space))
        colours = rng.uniform(*_COLOURS, len(space))
        values = np.where(space.is_appearance, colours, space.nominal * factors)
        return cls(values, rng.uniform(-_OFFSET_RAD, _OFFSET_RAD, num_joints))


# (T + 1, H, W₁ + W₂, 3) drawn frames of views so many pixels wide, to what cameras record
Record = Callable[[np.ndarray, Sequence[int], float, np.random.Generator], np.ndarray]


def film(
    task: Task,
    world: World,
    out: Path,
    episodes: int,
    steps: int,
    seed: int,
    widths: Mapping[str, int] | None = None,
    as_recorded: Record = lambda frames, widths, step_s, rng: frames,
) -> None:
    """Recordings, as a robot would have made them, into the new folder `out`.

    `widths`: {name: pixels} of each camera's video; None: one camera, whose pictures are square.
    """
    rng = np.random.default_rng((seed, 1))
    shapes = zip(task.cameras, (widths or {"": _PIXELS}).values(), strict=True)
    views = [View(footage.camera, width / _PIXELS) for footage, width in shapes]
    simulator = filming_whole(task).simulator(
        image_size=_PIXELS, renderer="opengl", quality=OPENGL_DM_CONTROL, views=views
    )
    seen = ObservationModel.of_simulator(task.sensors)
    operator = Operator(simulator, world.parameters, task.step_s, _DELAY_STEPS, rng)
    filmed: list[Trajectory] = []
    for _ in range(episodes):
        start, actions = operator.push(steps)
        rollouts = simulator.roll_out(
            world.parameters[None],
            operator.late(actions)[None],
            rng,
            seen.observe_beside(),
            starts=start[None],
        )
        (trajectory,) = seen.record(simulator, rollouts, rng)
        (name,) = trajectory.readings
        readings = {name: trajectory.readings[name] + world.offsets}
        frames = as_recorded(trajectory.frames, simulator.widths, task.step_s, rng)
        commands = actions.astype(np.float32)
        filmed.append(replace(trajectory, frames=frames, actions=commands, readings=readings))
    columns = task.action_columns
    assert columns is not None, "the tuning file names them"
    write_dataset(
        out,
        filmed,
        action_names=columns,
        robot_type=task.name,
        task=task.description,
        widths=widths,
        reading_names={sensor.name: sensor.column_names for sensor in task.sensors},
    )
    truth = dict(zip(task.parameters.names, world.parameters.tolist(), strict=True))
    (out / "truth.json").write_text(json.dumps(truth, indent=2) + "\n")
