"""A world of the two arms that differs from the model, and recordings of it."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.record import filming_whole
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


def film(task: Task, world: World, out: Path, episodes: int, steps: int, seed: int) -> None:
    """Recordings, as a robot would have made them, into the new folder `out`."""
    rng = np.random.default_rng((seed, 1))
    whole = filming_whole(task)
    simulator = whole.simulator(image_size=_PIXELS, renderer="opengl", quality=OPENGL_DM_CONTROL)
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
        filmed.append(replace(trajectory, actions=actions.astype(np.float32), readings=readings))
    columns = task.action_columns
    assert columns is not None, "the tuning file names them"
    write_dataset(
        out,
        filmed,
        action_names=columns,
        robot_type=task.name,
        task=task.description,
        reading_names={sensor.name: sensor.column_names for sensor in task.sensors},
    )
    truth = dict(zip(task.parameters.names, world.parameters.tolist(), strict=True))
    (out / "truth.json").write_text(json.dumps(truth, indent=2) + "\n")
