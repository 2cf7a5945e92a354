"""Quadrotors, found from motor commands and motion capture alone.

The recorded flights are another program's: rigid-body equations in steps of .5 ms, motors that lag,
linear and a little quadratic drag, and commands and motion capture that come late. Each is cut out
of a flight, so motors run where it begins. Inertias, thrust, drag, the motors' lag and the delay
are drawn from a seed. `weighed`: the mass is known; else mass, inertias and forces times one factor
give the same motion, and no interval may leave the truth out. The plain command's own function
tunes to six flights of six seconds. The last line is one JSON object.
"""

import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from common import machine, record_figures
from scipy.spatial.transform import Rotation

from simtune.config import TuneConfig
from simtune.tuning_run import tune

_SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="base">
    <joint name="x" type="slide" axis="1 0 0" damping=".3"/>
    <joint name="y" type="slide" axis="0 1 0" damping=".3"/>
    <joint name="z" type="slide" axis="0 0 1" damping=".3"/>
    <joint name="yaw" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/>
    <joint name="roll" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="{mass}" diaginertia=".006 .007 .011"/>
    <site name="1" pos=".12 -.12 0"/><site name="2" pos=".12 .12 0"/>
    <site name="3" pos="-.12 .12 0"/><site name="4" pos="-.12 -.12 0"/>
  </body></worldbody>
  <actuator>
    <motor name="m1" site="1" gear="0 0 6 0 0 .1" ctrlrange="0 1"/>
    <motor name="m2" site="2" gear="0 0 6 0 0 -.1" ctrlrange="0 1"/>
    <motor name="m3" site="3" gear="0 0 6 0 0 .1" ctrlrange="0 1"/>
    <motor name="m4" site="4" gear="0 0 6 0 0 -.1" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""
_TUNE = """
model = "scene.xml"
control_timestep_s = 0.01
[[sensors]]
name = "place"
columns = ["measured.x", "measured.y", "measured.z"]
joints = ["x", "y", "z"]
noise = 0.0005
offset = 0
[[sensors]]
name = "attitude"
columns = ["measured.yaw", "measured.pitch", "measured.roll"]
joints = ["yaw", "pitch", "roll"]
noise = 0.002
offset = 0
"""
_PARAMETER = '\n[[parameters]]\nname = "{}"\n{}\n'
_INERTIA = 'field = "body_inertia"\ncomponent = {}\nobjects = "base"'
_TUNED = {
    "ixx": _INERTIA.format(0),
    "iyy": _INERTIA.format(1),
    "izz": _INERTIA.format(2),
    "thrust": 'kind = "gain"\nobjects = "m*"',
    "drag": 'kind = "damping"\nobjects = ["x", "y", "z"]',
    "lag": 'kind = "lag"\nobjects = "m*"\nnominal = 0.05',
    "mass": 'kind = "mass"\nobjects = "base"',
}
_NOMINAL = {"ixx": 0.006, "iyy": 0.007, "izz": 0.011, "thrust": 1.0, "drag": 1.0, "lag": 0.05}
_HEADER = "time,m1,m2,m3,m4," + ",".join(
    f"measured.{j}" for j in ["x", "y", "z", "yaw", "pitch", "roll"]
)
_STEP_S, _SUBSTEPS, _STEPS, _BEFORE, _FLIGHTS = 0.01, 20, 600, 100, 6
_NOISE = np.repeat([5e-4, 2e-3], 3)  # m, rad
_ARM, _GRAVITY, _NOMINAL_MASS = 0.12, 9.81, 1.0  # m, m/s², kg
_FORCE, _TORQUE = 6.0, 0.1  # N, N·m of a motor of gain 1
_HEIGHT = np.array([0, 0, 1.0])  # m
_SIDES = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [1, -1, 1, -1]])  # roll, pitch, yaw


def main(
    seeds: tuple[int, ...] = (0, 1, 2),
    minutes: float = 4.0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        seeds: Of truths and flights.
        minutes: Each run's --budget-minutes.
        record: Write the figures into this file of docs/results, too.
        quick: One world, with little time.
    """
    rows = []
    for seed in seeds[:1] if quick else seeds:
        for weighed in (True,) if quick else (True, False):
            with TemporaryDirectory() as folder:
                rows.append(_run(seed, weighed, 0.5 if quick else minutes, Path(folder)))
            print(rows[-1])
    record_figures(record, ["seed", "weighed"], rows)
    held = sum(row["held"] for row in rows) / sum(row["parameters"] for row in rows)
    figures = {"runs": len(rows), "held": round(held, 3)}
    print(json.dumps({"benchmark": "flying", "quick": quick, **machine(), **figures}))


def _run(seed: int, weighed: bool, minutes: float, folder: Path) -> dict[str, Any]:
    """One world, found with or without its mass: what `docs/results` shows of it."""
    rng = np.random.default_rng(seed)
    mass = _NOMINAL_MASS * 2.0 ** rng.uniform(-0.7, 0.7)
    # In proportion to the mass, which a model's builder would do as well as he can
    size = {"thrust": mass, "ixx": mass, "iyy": mass, "izz": mass}
    truth = {n: size.get(n, 1) * v * 2.0 ** rng.uniform(-0.5, 0.5) for n, v in _NOMINAL.items()}
    truth["izz"] = np.clip(truth["izz"], None, 0.98 * (truth["ixx"] + truth["iyy"]))
    robot, late_s = truth | {"mass": mass}, rng.uniform(5e-3, 30e-3)
    (folder / "real").mkdir()
    for flight in range(_FLIGHTS):
        rows = _fly(robot, late_s, rng)
        np.savetxt(folder / f"real/{flight}.csv", rows, "%.6f", ",", header=_HEADER, comments="")
    (folder / "scene.xml").write_text(_SCENE.format(mass=mass if weighed else _NOMINAL_MASS))
    names = [name for name in _TUNED if not (weighed and name == "mass")]
    tuned = "".join(_PARAMETER.format(name, _TUNED[name]) for name in names)
    (folder / "tune.toml").write_text(_TUNE + tuned)
    began_s = time.monotonic()
    config = TuneConfig(
        task=str(folder / "tune.toml"), real=str(folder / "real"), out=folder / "run",
        budget_minutes=minutes, seed=seed,
    )  # fmt: skip
    found = tune(config)["parameters"]
    holds = {n: bool(found[n]["low"] <= robot[n] <= found[n]["high"]) for n in names}
    errors = {n: round(float(100 * abs(found[n]["mean"] / robot[n] - 1)), 1) for n in names}
    return {
        "seed": seed,
        "weighed": weighed,
        "percent_errors": errors,
        "verdicts": {n: found[n]["verdict"] for n in names},
        "parameters": len(names),
        "held": sum(holds.values()),
        "identified_missed": [
            n for n in names if found[n]["verdict"] == "identified" and not holds[n]
        ],
        "seconds": round(time.monotonic() - began_s, 1),
    }


def _fly(robot: dict[str, float], late_s: float, rng: np.random.Generator) -> np.ndarray:
    """(T + 1, 11) rows of one flight: times, commands, readings."""
    hover = robot["mass"] * _GRAVITY / (4 * _FORCE * robot["thrust"])
    place, speed = _HEIGHT, np.zeros(3)
    turn, rate = Rotation.identity(), np.zeros(3)
    motors, late = np.full(4, hover), round(late_s / (_STEP_S / _SUBSTEPS))
    asked = [np.full(4, hover)] * (late + 1)  # by half a millisecond
    goals, rows = rng.normal(0, 0.5, (_STEPS // 100 + 3, 4)), []
    for t in range(-_BEFORE, _STEPS + 1):
        commands = _command(robot, hover, goals[t // 100 + 1], place, speed, turn, rate)
        commands = np.clip(commands + 0.01 * rng.normal(size=4), 0.02, 1)
        if t >= 0:
            read = np.append(place, turn.as_euler("ZYX")) + _NOISE * rng.normal(size=6)
            rows.append([t * _STEP_S, *commands, *read])
        for _ in range(_SUBSTEPS):
            asked = [*asked[1:], commands]
            step = _STEP_S / _SUBSTEPS
            motors = motors + (asked[0] - motors) * -np.expm1(-step / robot["lag"])
            pushed, turned = _accelerations(robot, motors, speed, turn, rate)
            speed, rate = speed + step * pushed, rate + step * turned
            place, turn = place + step * speed, turn * Rotation.from_rotvec(step * rate)
    return np.array(rows)


def _accelerations(
    robot: dict[str, float], motors: np.ndarray, speed: np.ndarray, turn: Rotation, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of the place, in the world, and of the rotation, in the body."""
    force = _FORCE * robot["thrust"] * motors
    lift = turn.apply([0, 0, force.sum()])
    drag = 0.3 * robot["drag"] * speed + 0.02 * np.linalg.norm(speed) * speed
    pushed = (lift - drag) / robot["mass"] - [0, 0, _GRAVITY]
    torque = np.append(_ARM * _SIDES[:2] @ force, _SIDES[2] @ force * _TORQUE / _FORCE)
    inertia = np.array([robot["ixx"], robot["iyy"], robot["izz"]])
    return pushed, (torque - np.cross(rate, inertia * rate)) / inertia


def _command(
    robot: dict[str, float],
    hover: float,
    goal: np.ndarray,
    place: np.ndarray,
    speed: np.ndarray,
    turn: Rotation,
    rate: np.ndarray,
) -> np.ndarray:
    """(4,) of a controller that flies to a goal, with a heading."""
    pull = np.clip(2.0 * (goal[:3] + _HEIGHT - place) - 2.2 * speed, -3, 3)
    yaw, pitch, roll = turn.as_euler("ZYX")
    ahead = np.cos(yaw) * pull[0] + np.sin(yaw) * pull[1]
    left = -np.sin(yaw) * pull[0] + np.cos(yaw) * pull[1]
    wanted = np.array([-left, ahead, 0]) / _GRAVITY - [roll, pitch, yaw - 0.5 * goal[3]]
    torque = [robot["ixx"], robot["iyy"], robot["izz"]] * (
        wanted * [60, 60, 12] - rate * [12, 12, 6]
    )
    unit = _FORCE * robot["thrust"] * np.array([_ARM, _ARM, _TORQUE / _FORCE])
    return hover * (1 + pull[2] / _GRAVITY) + _SIDES.T @ (torque / unit) / 4


if __name__ == "__main__":
    tyro.cli(main)
