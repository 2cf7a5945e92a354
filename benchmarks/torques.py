"""The servos and masses of an arm, from encoders alone and beside the torques of its motors.

The recorded arm is integrated in steps of .4 ms, with a servo law of its own and an encoder of 8192
counts; the model tuned to it takes steps of 2 ms. Its six gains, three frictions and two masses are
drawn from a seed. Encoders hardly tell a factor on all of them: a rotor's inertia and a link of
known mass are all that sets it. The plain command's own function tunes to five episodes of five
seconds. The last line is one JSON object.
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
  <compiler angle="radian"/>
  <option timestep="{timestep_s}" integrator="implicitfast"><flag contact="disable"/></option>
  <default><joint damping=".1"/></default>
  <worldbody><body name="base" pos="0 0 .5">
    <joint name="j0" axis="0 0 1" armature=".02" frictionloss="{friction0}"/>
    <geom type="cylinder" size=".05 .05" mass=".8"/>
    <body name="upper" pos="0 0 .05">
      <joint name="j1" axis="0 1 0" armature=".02" frictionloss="{friction1}"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".025" mass="{upper}"/>
      <body name="lower" pos=".3 0 0">
        <joint name="j2" axis="0 1 0" armature=".01" frictionloss="{friction2}"/>
        <geom type="capsule" fromto="0 0 0 .25 0 0" size=".02" mass=".4"/>
        <body name="payload" pos=".25 0 0"><geom type="sphere" size=".03" mass="{payload}"/></body>
      </body>
    </body>
  </body></worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""
_MOTOR = '<motor name="a{i}" joint="j{i}"/>'
_SERVO = '<position name="a{i}" joint="j{i}" kp="{kp}" kv="{kv}" ctrlrange="-2 2"/>'
_NOMINAL = {
    **{"kp0": 60.0, "kp1": 80.0, "kp2": 40.0, "kv0": 4.0, "kv1": 5.0, "kv2": 2.0},
    **{"friction0": 0.2, "friction1": 0.2, "friction2": 0.2, "upper": 1.2, "payload": 0.4},
}
_KINDS = {"kp": "gain", "kv": "gain_damping", "friction": "friction_loss"}
_TUNE = """
model = "arm.xml"
control_timestep_s = 0.02
[[sensors]]
name = "encoders"
joints = ["j0", "j1", "j2"]
noise = 0.0006
offset = 0
"""
_TORQUES = """
[[sensors]]
name = "torques"
joints = ["j0", "j1", "j2"]
quantity = "torque"
noise = 0.05
"""
_PARAMETER = '\n[[parameters]]\nname = "{}"\nkind = "{}"\nobjects = "{}"\n'
_HEADER = "time,a0,a1,a2," + ",".join(
    f"measured.j{i}{q}" for q in ("", ".torque") for i in range(3)
)
_TIMESTEP_S, _STEP_S, _STEPS, _EPISODES = 4e-4, 0.02, 250, 5
_COUNT, _ENCODER_NOISE, _TORQUE_NOISE = 2 * np.pi / 8192, 5e-4, 0.05  # rad, rad, N·m


def main(
    seeds: tuple[int, ...] = (0, 1, 2),
    minutes: float = 2.0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        seeds: Of truths and motions.
        minutes: Each run's --budget-minutes.
        record: Write the figures into this file of docs/results, too.
        quick: One world, with little time.
    """
    rows = []
    for seed in seeds[:1] if quick else seeds:
        with TemporaryDirectory() as folder:
            rows += _run(seed, 0.5 if quick else minutes, Path(folder))
    record_figures(record, ["seed", "readings"], rows)
    held = {
        kind: sum(row["held"] for row in rows if row["readings"] == kind)
        for kind in ("encoders", "encoders and torques")
    }
    figures = {"worlds": len(rows) // 2, "parameters": len(_NOMINAL), "held": held}
    print(json.dumps({"benchmark": "torques", "quick": quick, **machine(), **figures}))


def _run(seed: int, minutes: float, folder: Path) -> list[dict[str, Any]]:
    """One world, found without and with torques: what `docs/results` shows of it."""
    rng = np.random.default_rng(seed)
    truth = {name: value * 2.0 ** rng.uniform(-0.7, 0.7) for name, value in _NOMINAL.items()}
    (folder / "real").mkdir()
    for episode in range(_EPISODES):
        rows = _moved(truth, rng)
        np.savetxt(folder / f"real/{episode}.csv", rows, "%.6f", ",", header=_HEADER, comments="")
    servos = [_SERVO.format(i=i, kp=_NOMINAL[f"kp{i}"], kv=_NOMINAL[f"kv{i}"]) for i in range(3)]
    scene = _SCENE.format(timestep_s=0.002, actuators="".join(servos), **_NOMINAL)
    (folder / "arm.xml").write_text(scene)
    parameters = "".join(_PARAMETER.format(name, *_kind_and_object(name)) for name in _NOMINAL)
    found = []
    for readings, sensors in (("encoders", _TUNE), ("encoders and torques", _TUNE + _TORQUES)):
        task = folder / f"{len(found)}.toml"
        task.write_text(sensors + parameters)
        began_s = time.monotonic()
        config = TuneConfig(
            task=str(task), real=str(folder / "real"), out=folder / f"run{len(found)}",
            budget_minutes=minutes, seed=seed,
        )  # fmt: skip
        estimates = tune(config)["parameters"]
        seconds = round(time.monotonic() - began_s, 1)
        row = {"seed": seed, "readings": readings, **_scored(estimates, truth), "seconds": seconds}
        found.append(row)
        print(row)
    return found


def _kind_and_object(name: str) -> tuple[str, str]:
    if name in ("upper", "payload"):
        return "mass", name
    kind, number = name[:-1], name[-1]
    return _KINDS[kind], f"{'j' if kind == 'friction' else 'a'}{number}"


def _scored(estimates: dict[str, Any], truth: dict[str, float]) -> dict[str, Any]:
    off = {name: 100 * abs(estimates[name]["mean"] / value - 1) for name, value in truth.items()}
    holds = {n: bool(estimates[n]["low"] <= v <= estimates[n]["high"]) for n, v in truth.items()}
    identified = [n for n in truth if estimates[n]["verdict"] == "identified"]
    return {
        "median_percent_error": round(float(np.median(list(off.values()))), 1),
        "largest_percent_error": round(float(max(off.values())), 1),
        "identified": len(identified),
        "parameters": len(truth),
        "held": sum(holds.values()),
        "identified_missed": [name for name in identified if not holds[name]],
    }


def _moved(truth: dict[str, float], rng: np.random.Generator) -> np.ndarray:
    """(T, 10) time, commands, encoders, torques of one episode, which begins at rest."""
    motors = "".join(_MOTOR.format(i=i) for i in range(3))
    model = mujoco.MjModel.from_xml_string(
        _SCENE.format(timestep_s=_TIMESTEP_S, actuators=motors, **truth)
    )
    data = mujoco.MjData(model)
    kp, kv = (np.array([truth[f"{name}{i}"] for i in range(3)]) for name in ("kp", "kv"))

    def move(goal: np.ndarray, seconds: float) -> None:
        for _ in range(round(seconds / _TIMESTEP_S)):
            data.ctrl[:] = kp * (goal - data.qpos) - kv * data.qvel
            mujoco.mj_step(model, data)

    middle = rng.uniform(-0.8, 0.8, 3)
    hertz, phase = rng.uniform(0.3, 1.5, 3), rng.uniform(0, 2 * np.pi, 3)
    size, rows = rng.uniform(0.3, 0.7, 3), []
    data.qpos[:] = middle
    move(middle, 2.0)
    for step in range(_STEPS):
        now_s = step * _STEP_S
        middle = middle + rng.uniform(-0.2, 0.2, 3) * (step % 50 == 25)
        goal = middle + size * (np.sin(2 * np.pi * hertz * now_s + phase) - np.sin(phase))
        read = np.round((data.qpos + _ENCODER_NOISE * rng.normal(size=3)) / _COUNT) * _COUNT
        torque = data.ctrl + _TORQUE_NOISE * rng.normal(size=3)
        rows.append(np.concatenate([[now_s], goal, read, torque]))
        move(goal, _STEP_S)
    return np.array(rows)


if __name__ == "__main__":
    tyro.cli(main)
