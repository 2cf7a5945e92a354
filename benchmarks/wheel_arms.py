"""Arms out of other people's wheels, with servos of every kind, and how they are moved."""

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.ndimage import gaussian_filter1d

from simtune.tasks import Task

STEP_S, NOISE = 0.02, 0.0005  # of recordings; rad, of an encoder
REACH = 0.35  # rad, standard deviation around the middle
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
    without: tuple[str, ...] = ()  # sections of the file, such as servos of its own


_G1 = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
_VIPERX = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
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
    "panda": Arm(
        "gym-hil==0.1.14", "gym_hil/assets/", "panda.xml",
        tuple(f"joint{i}" for i in range(1, 8)),
        ("*_driver_joint", "*_coupler_joint", "*_spring_link_joint", "*_follower_joint"),
        400.0, 40.0, 60.0, 0.1, ("tendon", "equality", "actuator", "sensor"),
    ),
    "viperx": Arm(
        "gym-aloha==0.1.5", "gym_aloha/assets/", "bimanual_viperx_transfer_cube.xml",
        tuple(f"vx300s_left/{j}" for j in _VIPERX),
        ("vx300s_right/*", "vx300s_left/*_finger", "red_box_joint"),
        800.0, 80.0, 100.0, 0.1, ("actuator", "keyframe"),
    ),
}  # fmt: skip


def unpack(arm: Arm, target: Path) -> None:
    """The model and its meshes; without contacts, at a step that recordings are made of."""
    for name, content in _files(arm):
        path = target / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    model = target / arm.file
    text = model.read_text()
    for section in arm.without:
        text = re.sub(f"<{section}>.*?</{section}>", "", text, flags=re.DOTALL)
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
    script = Path(__file__).parents[1] / "examples" / "unpack_wheel.py"
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, script, arm.wheel, arm.folder, folder], check=True)
        files = [path for path in Path(folder).rglob("*") if path.is_file()]
        return [(str(path.relative_to(folder)), path.read_bytes()) for path in files]


def tuning_file(arm: Arm) -> str:
    """Every kind of parameter that a servo and its joint have."""
    first, second, third, fourth = arm.joints[:4]
    lines = [f'model = "model/{arm.file}"', f"control_timestep_s = {STEP_S}"]
    lines += [f"fixed_joints = {json.dumps(arm.fixed)}"] * bool(arm.fixed)
    lines += ["[[sensors]]", 'name = "arm"', f"joints = {json.dumps(arm.joints)}", "offset = 0"]
    lines += [f'columns = "observation.state"\nnoise = {NOISE}']
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
    plain = name.replace("/", "_")
    lines = ["[[parameters]]", f'name = "{plain}"', f'kind = "{kind}"']
    return [*lines, f"objects = {json.dumps(objects)}", *(f"{k} = {v}" for k, v in numbers.items())]


def middle(task: Task, joints: tuple[str, ...]) -> np.ndarray:
    """(J,) of each joint's limits; half a turn where it has none."""
    model = task.load_model()
    low, high = (np.array([model.joint(j).range[k] for j in joints]) for k in (0, 1))
    return np.where(high > low, (low + high) / 2, np.pi)


def wandering(
    shape: tuple[int, int, int], sigma: int, rng: np.random.Generator, reach: float = REACH
) -> np.ndarray:
    """(E, T, J) smooth random motion by `reach`, rad, around 0; `sigma`: steps of a Gaussian."""
    smooth = gaussian_filter1d(rng.normal(size=shape), sigma, axis=1)
    return reach * smooth / smooth.std((0, 1))
