"""Servos of arms out of other people's wheels, found from joint readings alone.

Each arm (Kinova's Jaco of dm_control, I2RT's YAM and the Unitree G1's right arm of mjlab) gets
servos whose stiffness, damping, torque limit, lag and delay, and whose joints' armature, damping,
dry friction and offset differ from the model's by up to a factor of two, drawn from a seed. Six
episodes of smooth random commands are recorded, with an encoder's noise, and tuned to by the
plain command's own function. The last line is one JSON object.
"""

import json
import subprocess
import sys
import time
import zipfile
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from common import machine, record_figures
from scipy.ndimage import gaussian_filter1d

from simtune.config import TuneConfig
from simtune.recordings import write_dataset
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory
from simtune.tuning_run import tune

_EPISODES, _STEPS, _STEP_S, _NOISE = 6, 250, 0.02, 0.0005
_OPTION = '<option timestep="0.005" integrator="implicitfast"><flag contact="disable"/></option>'


@dataclass(frozen=True)
class Arm:
    wheel: str | None  # to be fetched; None: dm_control's, which is there
    folder: str  # in the wheel
    file: str
    joints: tuple[str, ...]  # from the base on
    fixed: tuple[str, ...]
    kp: float
    kv: float
    torque_limit: float  # of the second joint
    armature: float  # nominal, of all


_G1 = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
ARMS = {
    "jaco": Arm(
        None, "dm_control/third_party/kinova/", "jaco_arm.xml",
        tuple(f"joint_{i}" for i in range(1, 7)), (), 300.0, 30.0, 40.0, 1.0,
    ),
    "yam": Arm(
        "mjlab==1.6.0", "mjlab/asset_zoo/robots/i2rt_yam/xmls/", "yam.xml",
        tuple(f"joint{i}" for i in range(1, 7)), ("*_finger",), 60.0, 3.0, 20.0, 0.02,
    ),
    "g1": Arm(
        "mjlab==1.6.0", "mjlab/asset_zoo/robots/unitree_g1/xmls/", "g1.xml",
        tuple(f"right_{j}_joint" for j in _G1),
        ("floating_base_joint", "left_*", "right_hip_*", "right_knee_*", "right_ankle_*",
         "waist_*", "right_wrist_*"), 40.0, 3.0, 8.0, 0.02,
    ),
}  # fmt: skip


def main(
    arms: tuple[str, ...] = tuple(ARMS),
    seeds: tuple[int, ...] = (0,),
    minutes: float = 5.0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        arms: Of jaco, yam, g1.
        seeds: Of truths, starts and commands.
        minutes: Each run's --budget-minutes.
        record: Write the figures into this file of docs/results, too.
        quick: The arm that needs no download.
    """
    rows = []
    for name in arms[:1] if quick else arms:
        for seed in seeds:
            with TemporaryDirectory() as folder:
                rows += _run(name, seed, minutes, Path(folder))
    for row in rows:
        print(row)
    known = [row for row in rows if row["verdict"] == "identified"]
    figures = {
        "parameters": len(rows),
        "held": round(sum(row["holds"] for row in rows) / len(rows), 3),
        "identified": len(known),
        "identified_within_5_percent": sum(row["percent_error"] <= 5 for row in known),
        "largest_identified_percent_error": max((r["percent_error"] for r in known), default=None),
    }
    record_figures(record, ["arm", "seed", "parameter"], rows)
    print(json.dumps({"benchmark": "arms", "quick": quick, **machine(), **figures}))


def _run(name: str, seed: int, minutes: float, folder: Path) -> list[dict[str, Any]]:
    """A row for each parameter."""
    arm, rng = ARMS[name], np.random.default_rng((seed, len(name)))
    unpack(arm, folder / "model")
    file = folder / "tune.toml"
    file.write_text(tuning_file(arm))
    task = load_task(str(file))
    space = task.parameters
    share = rng.uniform(-1, 1, len(space))
    truth = np.where(space.nominal > 0, space.nominal * 2.0**share, 0.06 * share)
    truth[list(space.names).index("delay")] = rng.uniform(0, 0.08)
    _record(task, arm, space.clip(truth), rng, folder / "real")
    began_s = time.monotonic()
    config = TuneConfig(
        task=str(file), real=str(folder / "real"), out=folder / "run", budget_minutes=minutes,
        seed=seed,
    )  # fmt: skip
    result = tune(config)
    seconds = round(time.monotonic() - began_s, 1)
    return [
        _row(name, seed, parameter, value, result["parameters"][parameter], seconds)
        for parameter, value in space.to_dict(space.clip(truth)).items()
    ]


def _row(
    arm: str, seed: int, parameter: str, truth: float, found: dict[str, Any], seconds: float
) -> dict[str, Any]:
    # What may be 0 is measured by a usual size of it.
    scale = {"delay": 0.1}.get(parameter, 0.1 if "offset" in parameter else truth)
    return {
        "arm": arm,
        "seed": seed,
        "parameter": parameter,
        "truth": round(truth, 5),
        "mean": round(found["mean"], 5),
        "percent_error": round(100 * abs(found["mean"] - truth) / scale, 2),
        "holds": bool(found["low"] <= truth <= found["high"]),
        "verdict": found["verdict"],
        "seconds": seconds,
    }


def unpack(arm: Arm, target: Path) -> None:
    """The model and its meshes; without contacts, at a step that recordings are made of."""
    for name, content in _files(arm):
        path = target / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    model = target / arm.file
    text = model.read_text()
    end = text.index(">", text.index("<mujoco")) + 1
    model.write_text(f"{text[:end]}\n{_OPTION}{text[end:]}")


def _files(arm: Arm) -> list[tuple[str, bytes]]:
    """(path from the arm's folder, content)."""
    if arm.wheel is None:
        spec = find_spec(arm.folder.split("/")[0])
        assert spec is not None
        assert spec.origin is not None
        root = Path(spec.origin).parents[1] / arm.folder
        files = (path for path in root.rglob("*") if path.is_file())
        return [(str(path.relative_to(root)), path.read_bytes()) for path in files]
    with TemporaryDirectory() as folder:
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", folder]
        subprocess.run([*pip, arm.wheel], check=True)
        wheel = zipfile.ZipFile(next(Path(folder).glob("*.whl")))
        names = [n for n in wheel.namelist() if n.startswith(arm.folder) and not n.endswith("/")]
        return [(name.removeprefix(arm.folder), wheel.read(name)) for name in names]


def tuning_file(arm: Arm) -> str:
    """Every kind of parameter that a servo and its joint have."""
    first, second, third, fourth = arm.joints[:4]
    lines = [f'model = "model/{arm.file}"', f"control_timestep_s = {_STEP_S}"]
    lines += [f"fixed_joints = {json.dumps(arm.fixed)}"] * bool(arm.fixed)
    lines += ["[[sensors]]", 'name = "arm"', f"joints = {json.dumps(arm.joints)}", "offset = 0"]
    lines += [f'columns = "observation.state"\nnoise = {_NOISE}']
    for joint in arm.joints:
        lines += ["[[actuators]]", f'name = "{joint}_servo"', f'joint = "{joint}"']
        lines += [f"kp = {arm.kp}", f"kv = {arm.kv}", "limited = false"]
        lines += [f"torque_limit = {arm.torque_limit}"] * (joint == second)
    servo = {joint: f"{joint}_servo" for joint in arm.joints}
    for joint in (first, second, third, fourth):
        lines += _parameter(f"{joint}_kp", "gain", servo[joint])
        lines += _parameter(f"{joint}_kv", "gain_damping", servo[joint])
    lines += _parameter("torque_limit", "torque_limit", servo[second])
    lines += _parameter("lag", "lag", servo[third])
    lines += _parameter("armature", "armature", first, nominal=arm.armature)
    lines += _parameter("friction_loss", "friction_loss", fourth, nominal=0.05 * arm.kp**0.5)
    lines += _parameter("damping", "damping", arm.joints[-1], nominal=0.3 * arm.kv)
    lines += _parameter("offset", "joint_offset", third)
    lines += _parameter("delay", "delay", *servo.values(), high=0.2)
    return "\n".join(lines) + "\n"


def _parameter(name: str, kind: str, *objects: str, **numbers: float) -> list[str]:
    lines = ["[[parameters]]", f'name = "{name}"', f'kind = "{kind}"']
    return [*lines, f"objects = {json.dumps(objects)}", *(f"{k} = {v}" for k, v in numbers.items())]


def _record(
    task: Task, arm: Arm, truth: np.ndarray, rng: np.random.Generator, folder: Path
) -> None:
    """Smooth random commands around a pose within the joints' limits, and what encoders read."""
    model, count = task.load_model(), len(arm.joints)
    low, high = (np.array([model.joint(j).range[k] for j in arm.joints]) for k in (0, 1))
    middle = np.where(high > low, (low + high) / 2, np.pi)
    wandering = rng.normal(size=(_EPISODES, _STEPS, count))
    wandering = gaussian_filter1d(wandering, 12, axis=1)
    wandering *= 0.35 / wandering.std((0, 1))
    actions = middle + wandering
    actions[1::2] = actions[1::2, (np.arange(_STEPS) // 40) * 40]  # half of them in steps
    worlds = np.repeat(truth[None], _EPISODES, 0)
    sensor = task.sensors[0]

    def start_at_command(batch, _: np.random.Generator) -> None:
        batch.qpos[:] = actions[:, 0]

    simulator = replace(task, initialize=start_at_command).simulator(image_size=16)
    played = simulator.roll_out(worlds, actions, rng, sensor.observe)
    assert len(played) == _EPISODES, "an episode diverged"
    readings = played.observed + _NOISE * rng.normal(size=played.observed.shape)
    nothing = np.empty((_STEPS + 1, 0, 0, 3), np.uint8)
    write_dataset(
        folder,
        [
            Trajectory(nothing, a.astype(np.float32), _STEP_S, {sensor.name: r})
            for a, r in zip(actions, readings, strict=True)
        ],
        action_names=[f"{joint}_servo" for joint in arm.joints],
        robot_type="simulated",
        task="smooth random commands",
        reading_names={sensor.name: list(arm.joints)},
    )


if __name__ == "__main__":
    tyro.cli(main)
