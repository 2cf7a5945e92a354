"""Mechanisms that nobody drew: links, joints, motors, light and a camera by random numbers.

A chain of one to three links hangs from a pivot, from a cart on a rail, or from a turntable. Each
joint is free, or has a motor; a turntable's joints may have servos. Two to four parameters of the
motion are unknown to the user, up to twice as much or half of what he has, and all colours.
"""

from dataclasses import dataclass

import numpy as np

_GRAVITY = 9.81
_HEIGHT = 1.0  # m of the chain's upper end above the floor
_KINDS = ("pivot", "rail", "turntable")
_SHAPES = ((120, 160), (128, 128), (180, 240))  # of pictures: height and width in px

_MODEL = """<mujoco>
  <compiler autolimits="true"/>
  <option timestep="0.005" integrator="implicitfast"/>
  <visual>
    <headlight ambient="{ambient} {ambient} {ambient}" diffuse="0.2 0.2 0.2" specular="0 0 0"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="{sky}" rgb2="{horizon}" width="64"
             height="64"/>
  </asset>
  <default>
    <geom contype="0" conaffinity="0"/>
  </default>
  <worldbody>
    <light directional="true" pos="0 0 3" dir="{lamp}" diffuse="0.5 0.5 0.5"
           specular="0.1 0.1 0.1"/>
    <camera name="front" {camera}/>
    <geom name="floor" type="plane" size="4 4 0.1" rgba="{floor} 1"/>
    <body name="base" pos="0 0 {height}">
      {base}
      <geom name="base" type="box" size="0.08 0.04 0.04" mass="0.5" rgba="0.5 0.5 0.5 1"/>
      {chain}
    </body>
  </worldbody>
  <actuator>
    {actuators}
  </actuator>
</mujoco>
"""
_BASES = {
    "pivot": "",
    "rail": '<joint name="base" type="slide" axis="1 0 0" range="-0.4 0.4" stiffness="8" '
    'damping="{damping_base}"/>',
    "turntable": '<joint name="base" axis="0 0 1" range="-120 120" armature="0.01" '
    'damping="{damping_base}"/>',
}
_LINK = """<body name="link_{i}" pos="{place}">
      <joint name="hinge_{i}" axis="0 1 0" range="-150 150" damping="{{damping_{i}}}"
             frictionloss="{{friction_{i}}}"/>
      <geom name="link_{i}" type="{shape}" size="0.025" fromto="0 0 0 0 0 -{length:.4f}"
            mass="{{mass_{i}}}" rgba="{{link_{i}}} 1"/>
      {below}
      </body>"""
_MOTOR = '<general name="gain_{name}" joint="{joint}" ctrlrange="-1 1" gainprm="{{gain_{name}}}"/>'
_SERVO = (
    '<position name="gain_{name}" joint="{joint}" ctrlrange="-0.8 0.8" kp="{{gain_{name}}}" '
    'kv="{{kv_{name}}}"/>'
)
_FIRST = """model = "scene.xml"
camera = "front"
control_timestep_s = {step_s}

[initial_state]
kind = "distribution"

[initial_state.joints]
{starts}
"""
_PARAMETER = '\n[[parameters]]\nname = "{name}"\nkind = "{kind}"\nobjects = "{objects}"\n'
_CAMERA = (
    '\n[[parameters]]\nname = "camera"\nkind = "camera_pose"\nwithin_m = 0.06\nwithin_rad = 0.06\n'
)
# Prefix of a parameter's name: kind in a tuning file, prefix of the object's name
_PARTS = {
    "mass": ("mass", "link_"),
    "damping": ("damping", "hinge_"),
    "friction": ("friction_loss", "hinge_"),
    "gain": ("gain", "gain_"),
}


@dataclass(frozen=True)
class Mechanism:
    """What is filmed, and what its user has of it."""

    kind: str
    world: str  # MJCF with the true values
    model: str  # MJCF with the user's
    tuning_file: str  # TOML
    truth: dict[str, float]  # of the parameters of the motion, and of colours' channels
    starts: dict[str, float]  # of each joint: how far from 0 episodes begin, in rad or m
    step_s: float  # a control step
    shape: tuple[int, int]
    is_aside: bool  # whether the user's camera is, and a parameter


def random_mechanism(seed: int) -> Mechanism:
    """Always the same for a seed."""
    rng = np.random.default_rng(seed)
    kind, num = str(rng.choice(_KINDS)), int(rng.integers(1, 4))
    lengths, masses = rng.uniform(0.18, 0.32, num), rng.uniform(0.15, 0.8, num)
    nominal, actuators = _dynamics(kind, lengths, masses, rng)
    text = {name: _numbers(rng.uniform(0.4, 0.9, 3)) for name in ("sky", "horizon")}
    text |= {"lamp": _numbers([*rng.uniform(-0.5, 0.5, 2), -1.0])}
    text |= {"ambient": _numbers(rng.uniform(0.25, 0.45)), "height": str(_HEIGHT)}
    base, chain = _BASES[kind], _chain(lengths)
    template = _MODEL.replace("{base}", base).replace("{chain}", chain)
    template = template.replace("{actuators}", "\n    ".join(actuators))

    coloured = [*(f"link_{i}" for i in range(num)), "floor"]
    rgb = {name: rng.uniform(0.15, 0.85, 3) for name in coloured}
    seen = {n: np.clip(its + rng.uniform(-0.2, 0.2, 3), 0.05, 0.95) for n, its in rgb.items()}
    unknown = _unknown(nominal, num, rng)
    true = nominal | {name: nominal[name] * 2 ** rng.uniform(-1, 1) for name in unknown}
    cameras, is_aside = _cameras(lengths.sum(), rng), bool(rng.random() < 0.4)

    def scene(values: dict[str, float], colours: dict[str, np.ndarray], camera: str) -> str:
        written = {name: f"{value:.6g}" for name, value in values.items()}
        its = {name: _numbers(colour) for name, colour in colours.items()}
        return template.format(**text, **written, **its, camera=camera)

    starts = {"base": 0.2 if kind == "rail" else 0.6} if kind != "pivot" else {}
    starts |= {f"hinge_{i}": 0.6 if i else 1.0 for i in range(num)}
    step_s = float(rng.choice([0.04, 0.05]))
    channels = {f"{n}_{c}": its[k] for n, its in rgb.items() for k, c in enumerate("rgb")}
    return Mechanism(
        kind=f"{kind}, {num} link{'s' * (num > 1)}",
        world=scene(true, rgb, cameras[0]),
        model=scene(nominal, seen, cameras[is_aside]),
        tuning_file=_tuning_file(unknown, coloured, starts, step_s, is_aside),
        truth={name: float(true[name]) for name in unknown} | channels,
        starts=starts,
        step_s=step_s,
        shape=_SHAPES[rng.integers(len(_SHAPES))],
        is_aside=is_aside,
    )


def _dynamics(
    kind: str, lengths: np.ndarray, masses: np.ndarray, rng: np.random.Generator
) -> tuple[dict[str, float], list[str]]:
    """Nominal values, measured in each hinge's weight, and the actuators."""
    num = len(lengths)
    # N·m by which gravity turns each hinge, at most
    arms = [[lengths[i:j].sum() + lengths[j] / 2 for j in range(i, num)] for i in range(num)]
    weights = [_GRAVITY * float(masses[i:] @ arms[i]) for i in range(num)]
    values = {f"mass_{i}": float(mass) for i, mass in enumerate(masses)}
    values |= {f"damping_{i}": rng.uniform(0.02, 0.06) * w for i, w in enumerate(weights)}
    values |= {f"friction_{i}": rng.choice([0.0, 0.03]) * w for i, w in enumerate(weights)}
    has_servos = kind == "turntable" and rng.random() < 0.5
    actuator = _SERVO if has_servos else _MOTOR
    driven = [i for i in range(num) if has_servos or rng.random() < 0.5]
    if kind == "pivot" and not driven:
        driven = [0]
    lines = [actuator.format(name=i, joint=f"hinge_{i}") for i in driven]
    values |= {
        f"gain_{i}": weights[i] * (4 if has_servos else rng.uniform(0.3, 0.7)) for i in driven
    }
    values |= {f"kv_{i}": 0.3 * weights[i] for i in driven}
    if kind != "pivot":
        inertia = float(masses @ lengths**2) + 0.02
        values["damping_base"] = 3.0 if kind == "rail" else 2.0 * inertia
        values["gain_base"] = rng.uniform(10, 16) if kind == "rail" else 8 * inertia
        values["kv_base"] = inertia
        if has_servos:
            values["gain_base"] = 30 * inertia
        lines.append(actuator.format(name="base", joint="base"))
    return values, lines


def _chain(lengths: np.ndarray) -> str:
    text = ""
    for i in reversed(range(len(lengths))):
        place = f"0 -0.06 {-lengths[i - 1] if i else 0:.4f}"
        shape = "box" if i % 2 else "capsule"
        text = _LINK.format(i=i, place=place, shape=shape, length=lengths[i], below=text)
    return text


def _unknown(nominal: dict[str, float], num: int, rng: np.random.Generator) -> list[str]:
    """The last link's mass, a damping, and by chance a gain and a dry friction."""
    found = [f"mass_{num - 1}", f"damping_{rng.integers(num)}"]
    for prefix in ("gain_", "friction_"):
        names = [name for name, value in nominal.items() if name.startswith(prefix) and value]
        if names and rng.random() < 0.6:
            found.append(str(rng.choice(names)))
    return found


def _cameras(reach: float, rng: np.random.Generator) -> tuple[str, str]:
    """The true camera, and one that is a centimetre or two and about a degree aside."""
    fovy, azimuth, elevation = rng.uniform(35, 50), rng.uniform(-0.5, 0.5), rng.uniform(0.0, 0.5)
    far_m = 1.25 * reach / np.tan(np.deg2rad(fovy) / 2) + 0.2
    level = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    target = np.array([0, 0, _HEIGHT]) + rng.uniform(-0.05, 0.05, 3)
    place = target + far_m * (level * np.cos(elevation) + [0, 0, np.sin(elevation)])
    off_m = rng.uniform(-0.02, 0.02, (2, 3))
    return _camera(place, target, fovy), _camera(place + off_m[0], target + off_m[1], fovy)


def _camera(place: np.ndarray, target: np.ndarray, fovy: float) -> str:
    ahead = (target - place) / np.linalg.norm(target - place)
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    axes = _numbers([*right, *np.cross(right, ahead)])
    return f'pos="{_numbers(place)}" xyaxes="{axes}" fovy="{fovy:.2f}"'


def _tuning_file(
    unknown: list[str], coloured: list[str], starts: dict[str, float], step_s: float, is_aside: bool
) -> str:
    lines = [f"{name} = {{ position = [{-far}, {far}] }}" for name, far in starts.items()]
    text = _FIRST.format(step_s=step_s, starts="\n".join(lines))
    for name in unknown:
        prefix, which = name.split("_")
        kind, part = _PARTS[prefix]
        text += _PARAMETER.format(name=name, kind=kind, objects=f"{part}{which}")
    for name in coloured:
        text += _PARAMETER.format(name=name, kind="colour", objects=name)
    return text + _CAMERA * is_aside


def _numbers(values: object) -> str:
    return " ".join(f"{value:.4f}" for value in np.atleast_1d(np.asarray(values, float)))
