"""A world of the two arms that differs from the model, and recordings of it."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from scipy.optimize import least_squares

from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.recordings import write_dataset
from simtune.simulation import OPENGL_DM_CONTROL, Rollouts, Simulator
from simtune.tasks import Task
from simtune.trajectory import Trajectory

_FACTOR = 2.0  # a parameter of motion is as many times too high or too low at most
_COLOURS = (0.25, 1.0)
_OFFSET_RAD = 0.02  # of an encoder, at most
_DELAY_STEPS = 1  # by which the arms follow late
_SIDES = ("left", "right")
_REACH_M = (0.44, 0.50)  # of a sweep, from the arm's base to between its fingers
_HEIGHT_M = 0.0  # that a sweep is sent to; friction in the joints holds the hand above it
_SWEEP_RAD = (0.22, 0.34)  # of the waist, to either side of the box
_WOBBLE_RAD, _WOBBLE_HZ = (0.05, 0.15), (0.4, 1.6)


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
    simulator = task.simulator(image_size=128, renderer="opengl", quality=OPENGL_DM_CONTROL)
    seen = ObservationModel.of_simulator(task.sensors)
    filmed: list[Trajectory] = []
    for _ in range(episodes):
        actions = _sweeps(task, steps, rng)
        late = actions[np.maximum(np.arange(steps) - _DELAY_STEPS, 0)]
        rollouts = _play(simulator, world.parameters, late, seen, rng)
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


def _play(
    simulator: Simulator,
    parameters: np.ndarray,
    actions: np.ndarray,
    seen: ObservationModel,
    rng: np.random.Generator,
) -> Rollouts:
    """An episode of (T, A) actions."""
    return simulator.roll_out(parameters[None], actions[None], rng, seen.observe_beside())


def _sweeps(task: Task, steps: int, rng: np.random.Generator) -> np.ndarray:
    """(T, A) commands: one arm after the other sweeps over the table, there and back.

    Both reach the box, and none the other one. All joints wobble besides, whatever they do.
    """
    model = task.load_model()
    home = model.key_qpos[0][: model.nu]
    seconds = np.arange(steps) * task.step_s
    share = seconds / (steps * task.step_s)
    actions, order = np.tile(home, (steps, 1)), rng.permutation(2)
    for turn, side in enumerate(order):
        columns = slice(6 * side, 6 * side + 6)
        low, width = home[columns].copy(), rng.uniform(*_SWEEP_RAD)
        low[1:3] = _reach(model, _SIDES[side], rng.uniform(*_REACH_M))
        width *= rng.choice([-1, 1])
        # Its own half of the time: over the table, down, there, back, and home
        at = np.array([0, 0.18, 0.38, 0.5, 0.62, 0.74, 0.86, 1]) / 2 + turn / 2
        poses = np.array([home[columns], home[columns], low, low, low, low, low, home[columns]])
        poses[1:5, 0], poses[5:7, 0] = width, -width
        poses[3:5, 0] = width * np.array([1, -1])
        for joint in range(6):
            actions[:, columns.start + joint] = np.interp(share, at, poses[:, joint])
    for joint in range(model.nu):
        size, hertz = rng.uniform(*_WOBBLE_RAD), rng.uniform(*_WOBBLE_HZ)
        # Not of an arm that is low: it would hit the table
        idle = np.abs(actions[:, joint] - home[joint]) < 1e-3 if joint % 6 in (1, 2) else 1.0
        phase = 2 * np.pi * rng.uniform()
        actions[:, joint] += idle * size * np.sin(2 * np.pi * hertz * seconds + phase)
    return actions


def _reach(model: mujoco.MjModel, side: str, reach_m: float) -> np.ndarray:
    """(2,) angles of shoulder and elbow that bring the hand down to the table, so far away."""
    data, site = mujoco.MjData(model), model.site(f"cali_{side}_site1").id
    first = model.jnt_qposadr[model.joint(f"vx300s_{side}/shoulder").id]
    base = model.body(f"vx300s_{side}").pos

    def away(angles: np.ndarray) -> list[float]:
        data.qpos[:] = model.key_qpos[0]
        data.qpos[first : first + 2] = angles
        mujoco.mj_kinematics(model, data)
        x, y, z = data.site_xpos[site] - base
        return [np.hypot(x, y) - reach_m, z - _HEIGHT_M]

    return least_squares(away, model.key_qpos[0][first : first + 2]).x
