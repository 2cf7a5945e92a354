"""Where the camera on a real robot's head is: two disjoint halves of the recordings agree or not.

`simtune check --camera-pose` by all episodes, by the first and the last half of them, and by every
other one, each from the tuning file's guess. The pictures in --picture are the recordings' frames
with the outlines of the simulated robot before the camera that all episodes tell. The last line is
one JSON object.
"""

import json
import time
from pathlib import Path
from typing import Any

import av
import numpy as np
import tyro
from common import machine, record_figures
from scipy.spatial.transform import Rotation

from simtune.budget import Budget
from simtune.camera_pose.find import find_pose
from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.scene import measured_states, unlocated_geoms, with_any_camera
from simtune.config import CheckConfig
from simtune.observation import ObservationModel
from simtune.real.observed import observed, open_recordings
from simtune.real.recorded import RecordedReal
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory

_HEIGHT_PX, _MOST_POINTS = 240, 10_000
_SHOWN = ((0, 0.6), (2, 0.4), (6, 0.5), (9, 0.3))  # episode, and how far into it
_OUTLINE = np.array([255, 0, 255])


def main(
    task: Path = Path("examples/unitree_g1/with_camera.toml"),
    real: Path = Path("../shared/recordings/real_g1"),
    minutes: float = 3.0,
    within_fov_deg: float = 0.0,
    picture: Path | None = None,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        task: A tuning file with a camera and [[sensors]] of the joints.
        real: Recordings.
        minutes: For each search, beside reading.
        within_fov_deg: How far off the field of view may be; 0: it is known.
        picture: Where to save frames with outlines, as FILE.png.
        record: Write the figures into this file of docs/results, too.
        quick: Two episodes, in half a minute.
    """
    config = CheckConfig(
        task=str(task), real=real, camera_pose=Path("camera.toml"), within_fov_deg=within_fov_deg
    )
    declared = load_task(config.task)
    seen = observed(declared, None, is_simulated=False)
    its = with_any_camera(declared, seen.cameras[0].footage, config)
    dataset = open_recordings(real, its, config, _HEIGHT_PX, seen)
    recorded = RecordedReal(dataset, seen.framed(dataset.aspects))
    every = recorded.collect(2 if quick else None)
    half = len(every) // 2
    parts = {"all": every, "first half": every[:half], "last half": every[half:]}
    parts |= {"even": every[::2], "odd": every[1::2]}
    found, rows = {}, []
    for name, trajectories in list(parts.items())[: 3 if quick else None]:
        began_s, budget = time.monotonic(), Budget(60 * (0.1 if quick else minutes))
        found[name] = find_pose(its, recorded.observation, trajectories, budget)
        rows.append(_row(name, found[name], time.monotonic() - began_s))
        print(rows[-1], flush=True)
    if picture:
        _save(picture, its, recorded.observation, every, found["all"])
    pairs = [("first half", "last half"), ("even", "odd")][: 1 if quick else None]
    apart = {f"{a}, {b}": _apart(found[a], found[b]) for a, b in pairs}
    rows += [{"episodes": f"{name}: apart", **difference} for name, difference in apart.items()]
    print(apart)
    record_figures(record, ["episodes"], rows)
    print(json.dumps({"benchmark": "head_camera", "quick": quick, **machine(), "apart": apart}))


def _row(name: str, found: dict[str, Any], seconds: float) -> dict[str, Any]:
    its = found["parameters"].values()
    reach_m = [(p["high"] - p["low"]) / 2 for p in its if p["unit"] == "m"]
    return {
        "episodes": name,
        "position": ", ".join(f"{x:.3f}" for x in found["position_m"]) + " m",
        "fov": f"{found['field_of_view_deg']:.2f}°",
        "interval": f"±{100 * max(reach_m):.1f} cm",
        "seconds": f"{seconds:.0f} s",
    }


def _apart(one: dict[str, Any], other: dict[str, Any]) -> dict[str, str]:
    turned = [Rotation.from_quat(np.roll(found["quat"], -1)) for found in (one, other)]
    moved_m = np.linalg.norm(np.subtract(one["position_m"], other["position_m"]))
    angle_deg = np.degrees((turned[0].inv() * turned[1]).magnitude())
    fov_deg = abs(one["field_of_view_deg"] - other["field_of_view_deg"])
    return {"position": f"{100 * moved_m:.2f} cm, {angle_deg:.2f}°", "fov": f"{fov_deg:.2f}°"}


def _save(
    path: Path,
    task: Task,
    seen: ObservationModel,
    trajectories: list[Trajectory],
    found: dict[str, Any],
) -> None:
    """Some frames side by side."""
    simulator, camera = task.simulator(image_size=1, views=()), task.cameras[0].camera
    size = (trajectories[0].frames.shape[1], trajectories[0].frames.shape[2])
    geometry = CameraGeometry.of(simulator.model, camera, task.parameters, size)
    world = np.array([[p["mean"] for p in found["parameters"].values()]])
    nothing = np.zeros((1, 0, simulator.num_actions))
    rest = simulator.roll_out(world, nothing, np.random.default_rng(0)).states[0, 0]
    hidden = unlocated_geoms(simulator.model, camera, seen)
    shown = []
    for episode, when in _SHOWN:
        if episode >= len(trajectories):
            break
        its = trajectories[episode]
        step = int(when * len(its))
        states = measured_states(simulator.model, seen, [its], rest)[step : step + 1]
        robot = Robot(simulator.model, camera, states, geometry, hidden)
        unit = task.parameters.to_unit(world[0])
        outlines = robot.outlines(unit, np.zeros(1, int), _MOST_POINTS)
        column, row = np.rint(outlines.pixels).astype(int).T
        shown.append(its.frames[step].copy())
        shown[-1][row, column] = _OUTLINE
    half = (len(shown) + 1) // 2
    picture = np.vstack([np.hstack(shown[:half]), np.hstack(shown[half : 2 * half])])
    _write_png(path, picture.astype(np.uint8))


def _write_png(path: Path, picture: np.ndarray) -> None:
    with av.open(str(path), "w", format="image2") as container:
        stream = container.add_stream("png", rate=1)
        stream.height, stream.width = picture.shape[:2]
        stream.pix_fmt = "rgb24"
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        container.mux([*stream.encode(frame), *stream.encode()])


if __name__ == "__main__":
    tyro.cli(main)
