"""Robots that balance on two wheels, found from encoders and an IMU alone.

No sensor measures how the base moves, and open loop the robot falls. Plain MuJoCo simulates each
robot, with a timestep of its own, while a controller holds it up, drives it, and turns it. It rolls
where a recording begins. Mass, motors' gain, wheels' damping and armature differ from the model's
by up to a factor of two, drawn from a seed. The plain command's own function tunes to six episodes
of eight seconds. The last line is one JSON object.
"""

import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import tyro
from common import machine, record_figures

from simtune.config import TuneConfig
from simtune.tuning_run import tune

_SCENE = """
<mujoco>
  <option timestep="{timestep}" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="trunk" pos="0 0 .05">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <joint name="z" type="slide" axis="0 0 1"/><joint name="yaw" axis="0 0 1"/>
      <joint name="pitch" axis="0 1 0"/>
      <geom type="box" size=".03 .06 .08" pos="0 0 .08" mass="{mass}" contype="0" conaffinity="0"/>
      <body pos="0 .08 0">
        <joint name="left" axis="0 1 0" damping="{damping}" armature="{armature}"
          frictionloss=".004"/>
        <geom type="cylinder" size=".05 .01" euler="90 0 0" mass=".08"/>
      </body>
      <body pos="0 -.08 0">
        <joint name="right" axis="0 1 0" damping="{damping}" armature="{armature}"
          frictionloss=".004"/>
        <geom type="cylinder" size=".05 .01" euler="90 0 0" mass=".08"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="left" joint="left" gear="{gain}" ctrlrange="-1 1"/>
    <motor name="right" joint="right" gear="{gain}" ctrlrange="-1 1"/>
  </actuator>
  <keyframe><key name="stand" qpos="0 0 0 0 0 0 0"/></keyframe>
</mujoco>
"""
_MODEL = {"mass": 0.6, "gain": 0.35, "damping": 8e-4, "armature": 2e-4}
_TUNE = """
model = "scene.xml"
control_timestep_s = 0.02
initial_state = {kind = "keyframe", keyframe = "stand"}

[[sensors]]
name = "imu"
columns = "measured.pitch"
joints = "pitch"

[[sensors]]
name = "gyroscope"
columns = "measured.pitch_rate"
joints = "pitch"
quantity = "velocity"

[[sensors]]
name = "wheels"
columns = ["measured.left", "measured.right"]
joints = ["left", "right"]

[[parameters]]
name = "mass"
kind = "mass"
objects = "trunk"
"""
_OF_WHEELS = '\n[[parameters]]\nname = "{0}"\nkind = "{0}"\nobjects = ["left", "right"]\n'
_HEADER = "time,left,right,measured.pitch,measured.pitch_rate,measured.left,measured.right"
_STEP_S, _STEPS, _EPISODES, _BEFORE = 0.02, 400, 6, 50
_NOISE = np.array([5e-4, 5e-3, 5e-4, 5e-4])  # rad, rad/s, rad, rad
_BIAS = 0.01  # rad/s, of the gyroscope
_ARM, _GRAVITY = 0.08, 9.81  # m, of the trunk's mass above the axle; m/s²
_YAW, _PITCH, _WHEELS = 3, 4, [5, 6]


def main(
    seeds: tuple[int, ...] = (0, 1, 2),
    minutes: float = 4.0,
    timestep: float = 1e-3,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        seeds: Of truths and of what the controller is asked to do.
        minutes: Each run's --budget-minutes.
        timestep: Of the recorded robots' physics, in seconds; the model's is .002.
        record: Write the figures into this file of docs/results, too.
        quick: One world, with little time.
    """
    rows = []
    for seed in seeds[:1] if quick else seeds:
        with TemporaryDirectory() as folder:
            rows.append(_run(seed, 1.0 if quick else minutes, timestep, Path(folder)))
        print(rows[-1])
    record_figures(record, ["seed", "timestep_ms"], rows)
    held = sum(row["held"] for row in rows) / sum(row["parameters"] for row in rows)
    figures = {"worlds": len(rows), "held": round(held, 3)}
    print(json.dumps({"benchmark": "balancing", "quick": quick, **machine(), **figures}))


def _run(seed: int, minutes: float, timestep: float, folder: Path) -> dict[str, Any]:
    """One world: what `docs/results` shows of it."""
    rng = np.random.default_rng(seed)
    factors = dict(zip(_MODEL, 2.0 ** rng.uniform(-1, 1, len(_MODEL)), strict=True))
    factors["gain"] **= 0.5  # a motor half as strong does not hold it up
    robot = {name: factor * _MODEL[name] for name, factor in factors.items()}
    _record(robot, timestep, rng, folder / "real")
    (folder / "scene.xml").write_text(_SCENE.format(timestep=0.002, **_MODEL))
    of_wheels = (_OF_WHEELS.format(name) for name in ("gain", "damping", "armature"))
    (folder / "tune.toml").write_text(_TUNE + "".join(of_wheels))
    began_s = time.monotonic()
    config = TuneConfig(
        task=str(folder / "tune.toml"), real=str(folder / "real"), out=folder / "run",
        budget_minutes=minutes, seed=seed,
    )  # fmt: skip
    found = tune(config)["parameters"]
    truth = factors | {"mass": robot["mass"]}  # of several objects a factor is found
    errors = {n: round(float(100 * abs(found[n]["mean"] / truth[n] - 1)), 2) for n in truth}
    return {
        "seed": seed,
        "timestep_ms": round(1e3 * timestep, 3),
        "percent_errors": errors,
        "verdicts": {n: found[n]["verdict"] for n in truth},
        "parameters": len(truth),
        "held": sum(bool(found[n]["low"] <= truth[n] <= found[n]["high"]) for n in truth),
        "seconds": round(time.monotonic() - began_s, 1),
    }


def _record(
    robot: dict[str, float], timestep: float, rng: np.random.Generator, folder: Path
) -> None:
    """Tables of episodes in which it does not fall."""
    model, num_done = mujoco.MjModel.from_xml_string(_SCENE.format(timestep=timestep, **robot)), 0
    folder.mkdir()
    while num_done < _EPISODES:
        rows = _drive(model, robot, rng)
        if np.abs(rows[:, 3]).max() < 0.6:
            name = folder / f"episode{num_done}.csv"
            np.savetxt(name, rows, "%.6f", ",", header=_HEADER, comments="")
            num_done += 1


def _drive(model: mujoco.MjModel, robot: dict[str, float], rng: np.random.Generator) -> np.ndarray:
    """(T + 1, 7) rows of one episode: times, commands, readings."""
    data, rows = mujoco.MjData(model), []
    data.qpos[_PITCH] = 0.03 * rng.normal()
    substeps, stiff = round(_STEP_S / model.opt.timestep), robot["mass"] * _GRAVITY * _ARM
    goals, (fast, wide) = 0.3 * rng.normal(size=_STEPS // 50 + 1), rng.uniform((2, 0), (6, 6))
    for t in range(-_BEFORE, _STEPS + 1):
        yaw, pitch, turning = data.qpos[_YAW], data.qpos[_PITCH], data.qvel[_PITCH]
        speed = data.qvel[0] * np.cos(yaw) + data.qvel[1] * np.sin(yaw)
        goal = goals[max(t, 0) // 50] + 0.1 * np.sin(2 * fast * t * _STEP_S)
        lean = pitch - np.clip(0.22 * (goal - speed), -0.25, 0.25)
        push = stiff * (2.2 * lean + 0.35 * turning) / (2 * robot["gain"])
        turn = 0.05 * np.sin(fast * t * _STEP_S + wide) - 0.01 * data.qvel[_YAW]
        sides = push + turn * np.array([-1, 1]) + 0.02 * rng.normal(size=2)
        commands = np.clip(sides, -1, 1)
        if t >= 0:
            read = np.array([pitch, turning + _BIAS, *data.qpos[_WHEELS]])
            rows.append([t * _STEP_S, *commands, *(read + _NOISE * rng.normal(size=4))])
        data.ctrl[:] = commands
        mujoco.mj_step(model, data, substeps)
    return np.array(rows)


if __name__ == "__main__":
    tyro.cli(main)
