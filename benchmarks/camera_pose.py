"""Where a camera is, from a guess 30 cm and 25° off, by the joints of arms out of other wheels.

Each arm (Kinova's Jaco of dm_control, I2RT's YAM and the Unitree G1's right arm of mjlab, Franka's
Panda of gym-hil, a ViperX of gym-aloha) moves smoothly before a camera somewhere around it, among
ten things that no model has, and is filmed by OpenGL with shadows at 320×240, through mp4. `simtune
check --camera-pose` gets the recordings, the model without those things, the field of view, and a
guess that is 30 cm off in a random direction and 25° about a random axis. The last line is one JSON
object.
"""

import json
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import tyro
from common import machine, record_figures
from scipy.spatial.transform import Rotation
from wheel_arms import ARMS, Arm, middle, tuning_file, unpack, wandering

from simtune.camera_pose import find_camera_pose
from simtune.cameras.views import View
from simtune.config import CheckConfig
from simtune.observation import ObservationModel
from simtune.real.observed import observed
from simtune.recordings import write_dataset
from simtune.simulation import OPENGL_DM_CONTROL
from simtune.tasks import Task, load_task

_EPISODES, _STEPS, _THINGS = 4, 60, 10
_OFF_M, _OFF_DEG = 0.3, 25.0
_REACH = 0.45  # rad, standard deviation of the joints around their middle
_HEIGHT, _WIDTH = 240, 320
_SKY = """<asset><texture type="skybox" builtin="gradient" rgb1=".5 .6 .7" rgb2=".35 .3 .3"
width="64" height="384"/></asset></mujoco>"""


def main(
    arms: tuple[str, ...] = tuple(ARMS),
    seeds: tuple[int, ...] = (0, 1),
    minutes: float = 2.0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        arms: Of jaco, yam, g1, panda, viperx.
        seeds: Of cameras, things, motions and guesses.
        minutes: Each search's --budget-minutes.
        record: Write the figures into this file of docs/results, too.
        quick: One arm that needs no download, in half a minute.
    """
    rows = []
    for name in arms[:1] if quick else arms:
        for seed in seeds[:1] if quick else seeds:
            with TemporaryDirectory() as folder:
                rows.append(_run(name, seed, 0.3 if quick else minutes, Path(folder)))
            print(rows[-1], flush=True)
    record_figures(record, ["arm", "seed"], rows)
    figures = {
        "cameras": len(rows),
        "median_cm": round(float(np.median([row["off_cm"] for row in rows])), 2),
        "median_deg": round(float(np.median([row["off_deg"] for row in rows])), 2),
        "within_1_cm_and_half_a_degree": sum(
            row["off_cm"] <= 1 and row["off_deg"] <= 0.5 for row in rows
        ),
        "held": round(float(np.mean([row["held"] for row in rows])), 3),
    }
    print(json.dumps({"benchmark": "camera_pose", "quick": quick, **machine(), **figures}))


def _run(name: str, seed: int, minutes: float, folder: Path) -> dict[str, Any]:
    arm, rng = ARMS[name], np.random.default_rng((seed, len(name), 7))
    unpack(arm, folder / "model")
    plain = tuning_file(arm)
    (folder / "tune.toml").write_text(
        plain + "\n[camera]\nposition_m = [0, 0, 9]\nquat = [1, 0, 0, 0]\n"
    )
    camera = _camera(load_task(str(folder / "tune.toml")), arm, rng)
    _film(folder, plain, camera, arm, rng)
    guess = _off(camera, rng)
    (folder / "tune.toml").write_text(f'{plain}{_table(guess)}background = "recording"\n')
    config = CheckConfig(
        task=str(folder / "tune.toml"),
        real=folder / "real",
        camera_pose=folder / "camera.toml",
        within_m=0.35,
        within_deg=30,
        budget_minutes=minutes,
        seed=seed,
    )
    began_s = time.monotonic()
    found = find_camera_pose(config)
    return {
        "arm": name,
        "seed": seed,
        **_errors(found, camera),
        "held": _held(found, camera),
        "warned": bool(found["warnings"]),
        "seconds": round(time.monotonic() - began_s),
    }


Camera = dict[str, Any]  # position_m, turn (a Rotation) and field_of_view_deg


def _camera(task: Task, arm: Arm, rng: np.random.Generator) -> Camera:
    """Somewhere around the arm, which it sees whole."""
    model = task.load_model()
    data = mujoco.MjData(model)
    data.qpos[:] = middle(task, arm.joints)
    mujoco.mj_forward(model, data)
    joints = np.array([data.body(model.joint(j).bodyid[0]).xpos for j in arm.joints])
    centre = joints.mean(0)
    reach = max(float(np.linalg.norm(joints - joints[0], axis=1).max()), 0.3)
    azimuth, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.15, 0.8)
    way = [np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height)]
    position = centre + reach * rng.uniform(1.9, 2.5) * np.array(way)
    backward = position - centre - rng.uniform(-0.1, 0.1, 3)
    backward /= np.linalg.norm(backward)
    right = np.cross([0, 0, 1], backward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(backward, right), backward], 1)
    turn = Rotation.from_matrix(axes) * Rotation.from_euler("z", rng.uniform(-5, 5), degrees=True)
    return {"position_m": position, "turn": turn, "field_of_view_deg": rng.uniform(42, 60)}


def _off(camera: Camera, rng: np.random.Generator) -> Camera:
    way, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turn = Rotation.from_rotvec(np.radians(_OFF_DEG) * axis)
    return {
        "position_m": camera["position_m"] + _OFF_M * way,
        "turn": camera["turn"] * turn,
        "field_of_view_deg": camera["field_of_view_deg"],
    }


def _table(camera: Camera) -> str:
    x, y, z, w = camera["turn"].as_quat()
    return (
        f"\n[camera]\nposition_m = {json.dumps(list(map(float, camera['position_m'])))}\n"
        f"quat = {json.dumps(list(map(float, (w, x, y, z))))}\n"
        f"field_of_view_deg = {float(camera['field_of_view_deg'])}\n"
    )


def _film(folder: Path, plain: str, camera: Camera, arm: Arm, rng: np.random.Generator) -> None:
    """Recordings in FOLDER/real, of a model with things that are gone afterwards."""
    model = folder / "model" / arm.file
    before = model.read_text()
    end = before.index(">", before.index("<worldbody")) + 1
    things = "\n".join(_thing(camera, rng) for _ in range(_THINGS))
    model.write_text(f"{before[:end]}\n{things}\n{before[end:]}".replace("</mujoco>", _SKY))
    (folder / "tune.toml").write_text(plain + _table(camera))
    task = load_task(str(folder / "tune.toml"))
    model.write_text(before)
    shape = (_EPISODES, _STEPS, len(arm.joints))
    actions = middle(task, arm.joints) + wandering(shape, 5, rng, _REACH)

    def start_at_command(batch, _: np.random.Generator) -> None:
        batch.qpos[:] = actions[:, 0]

    simulator = replace(task, initialize=start_at_command).simulator(
        image_size=_HEIGHT,
        views=[View(task.cameras[0].camera, _WIDTH / _HEIGHT)],
        step_s=0.1,
        renderer="opengl",
        quality=OPENGL_DM_CONTROL,
    )
    seen: ObservationModel = observed(task, None, is_simulated=True)
    worlds = np.repeat(task.parameters.nominal[None], _EPISODES, 0)
    rollouts = simulator.roll_out(worlds, actions, rng, seen.observe_beside())
    sensor = task.sensors[0]
    write_dataset(
        folder / "real",
        seen.record(simulator, rollouts, rng),
        action_names=[f"{joint}_servo" for joint in arm.joints],
        robot_type="simulated",
        task="smooth random motion",
        reading_names={sensor.name: list(arm.joints)},
    )


def _thing(camera: Camera, rng: np.random.Generator) -> str:
    """Behind the arm, as the camera sees it, or beneath."""
    away = camera["turn"].apply(
        [rng.uniform(-1.2, 1.2), rng.uniform(-0.8, 0.8), -rng.uniform(3, 4)]
    )
    kind = rng.choice(["box", "sphere", "ellipsoid", "cylinder"])
    size, turn, colour = rng.uniform(0.1, 0.5, 3), rng.uniform(-90, 90, 3), rng.uniform(0, 1, 3)
    turned = Rotation.from_euler("xyz", turn, degrees=True).as_quat()[[3, 0, 1, 2]]
    place = camera["position_m"] + away
    said = (" ".join(f"{v:.3f}" for v in values) for values in (place, size, turned, colour))
    return '<geom type="{}" pos="{}" size="{}" quat="{}" rgba="{} 1"/>'.format(kind, *said)


def _errors(found: dict[str, Any], camera: Camera) -> dict[str, float]:
    w, x, y, z = found["quat"]
    apart = camera["turn"].inv() * Rotation.from_quat([x, y, z, w])
    off_m = np.linalg.norm(np.array(found["position_m"]) - camera["position_m"])
    return {
        "off_cm": round(100 * float(off_m), 2),
        "off_deg": round(float(np.degrees(apart.magnitude())), 2),
    }


def _held(found: dict[str, Any], camera: Camera) -> float:
    """The share of the intervals of the position that hold."""
    truth = dict(zip(("camera_x", "camera_y", "camera_z"), camera["position_m"], strict=True))
    its = found["parameters"]
    holds = [its[name]["low"] <= value <= its[name]["high"] for name, value in truth.items()]
    return float(np.mean(holds))


if __name__ == "__main__":
    tyro.cli(main)
