"""How fast robots made of meshes are drawn: ALOHA, the Unitree G1 and the Adroit hand.

Their models come out of other people's wheels. Sixty-four random poses of each are drawn by
simtune's ray caster and by MuJoCo's own renderer (OpenGL, with shadows), in turns. Seconds are
those that the process computes, so that others on the machine count little. The last line is one
JSON object.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import tyro
from common import machine, record_figures

from simtune.cameras.views import View
from simtune.parameters import Parameter, ParameterSpace
from simtune.simulation import PictureSettings
from simtune.simulation.rendering.renderer import make_renderer
from simtune.vision.keypoints import is_drawn

_UNPACK = Path(__file__).parents[1] / "examples" / "unpack_wheel.py"
_ROBOTS = {
    "aloha": ("gym-aloha==0.1.5", "gym_aloha/assets/", "bimanual_viperx_transfer_cube.xml"),
    "g1": ("mjlab==1.6.0", "mjlab/asset_zoo/robots/unitree_g1/xmls/", "g1.xml"),
    "adroit": (
        "gymnasium-robotics==1.4.2",
        "gymnasium_robotics/envs/assets/",
        "adroit_hand/adroit_relocate.xml",
    ),
}
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_POSES, _BY_OPENGL = 64, 12
_POSE_RAD = 0.15  # standard deviation of joints
_LARGEST_M = 1.5  # of a model, to look at it from as far away
_CAMERA = "simtune_benchmark"


def main(
    robots: tuple[str, ...] = tuple(_ROBOTS),
    sizes: tuple[int, ...] = (64, 96, 128),
    rounds: int = 3,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        robots: Of aloha, g1, adroit.
        sizes: Sides of the pictures, in pixels.
        rounds: In turns; medians count.
        record: Write the figures into this file of docs/results, too.
        quick: One robot, one size, one round.
    """
    if quick:
        robots, sizes, rounds = robots[:1], sizes[:1], 1
    rows = []
    for name in robots:
        with TemporaryDirectory() as folder:
            model = _load(name, Path(folder))
            states = _poses(model, np.random.default_rng(0))
            for size in sizes:
                rows.append({"robot": name, "size": size, **_measure(model, states, size, rounds)})
                print(rows[-1], file=sys.stderr, flush=True)
    record_figures(record, ["robot", "size"], rows)
    print(json.dumps({"benchmark": "render_meshes", "quick": quick, **machine(), "rows": rows}))


def _load(name: str, folder: Path) -> mujoco.MjModel:
    """With a camera that sees it whole."""
    wheel, assets, file = _ROBOTS[name]
    subprocess.run([sys.executable, _UNPACK, wheel, assets, folder], check=True)
    spec = mujoco.MjSpec.from_file(str(folder / file))
    model = spec.compile()
    data = mujoco.MjData(model)
    _rest(model, data)
    mujoco.mj_forward(model, data)
    middle = data.subtree_com[1]
    away = np.array([0.9, -0.9, 0.6]) * min(model.stat.extent, _LARGEST_M)
    backward = away / np.linalg.norm(away)
    right = np.cross([0, 0, 1], backward)
    right /= np.linalg.norm(right)
    quaternion = np.empty(4)
    axes = np.stack([right, np.cross(backward, right), backward], 1)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    spec.worldbody.add_camera(name=_CAMERA, pos=middle + away, quat=quaternion, fovy=45)
    return spec.compile()


def _rest(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """The model's first keyframe, where it has one."""
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)


def _poses(model: mujoco.MjModel, rng: np.random.Generator) -> np.ndarray:
    """(n, S) states around the one at rest."""
    states = np.empty((_POSES, mujoco.mj_stateSize(model, _STATE)))
    for state in states:
        data = mujoco.MjData(model)
        _rest(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.normal(0, _POSE_RAD, model.nv), 1)
        mujoco.mj_getState(model, data, state, _STATE)
    return states


def _measure(model: mujoco.MjModel, states: np.ndarray, size: int, rounds: int) -> dict[str, Any]:
    space = _space(model)
    ours = make_renderer(model, space, View(_CAMERA), PictureSettings(image_size=size))
    parameters = np.repeat(space.nominal[None], len(states), 0)
    theirs, data = mujoco.Renderer(model, size, size), mujoco.MjData(model)

    def draw_by_opengl() -> None:
        for state in states[:_BY_OPENGL]:
            mujoco.mj_setState(model, data, state, _STATE)
            mujoco.mj_forward(model, data)
            theirs.update_scene(data, _CAMERA)
            theirs.render()

    ours.render(states[:4], parameters[:4])  # compiles
    draw_by_opengl()
    times = [
        (_seconds(lambda: ours.render(states, parameters)), _seconds(draw_by_opengl))
        for _ in range(rounds)
    ]
    theirs.close()
    by_ray, by_opengl = (np.median(times, 0) / (len(states), _BY_OPENGL)).tolist()
    return {
        "triangles": _triangles(model),
        "frames_per_s": round(1 / by_ray),
        "opengl_frames_per_s": round(1 / by_opengl, 1),
        "ratio": round(by_opengl / by_ray, 1),
    }


def _seconds(work: Callable[[], object]) -> float:
    """Of computing, on all cores together."""
    began = time.process_time()
    work()
    return time.process_time() - began


def _space(model: mujoco.MjModel) -> ParameterSpace:
    """One parameter, which changes no picture."""
    body = next(b for b in map(model.body, range(1, model.nbody)) if b.name and b.mass[0])
    mass = float(body.mass[0])
    return ParameterSpace(
        [
            Parameter(
                name="mass",
                field="body_mass",
                objects=(body.name,),
                unit="kg",
                nominal=mass,
                low=mass / 2,
                high=2 * mass,
            )
        ]
    )


def _triangles(model: mujoco.MjModel) -> int:
    """Of all meshes that are drawn."""
    is_mesh = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    meshes = model.geom_dataid[is_mesh & is_drawn(model)]
    return int(model.mesh_facenum[meshes].sum())


if __name__ == "__main__":
    tyro.cli(main)
