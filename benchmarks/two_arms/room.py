"""ALOHA in a room that its model does not know, filmed by two cameras as real ones would.

A photograph lies on the table. One camera hangs over it, another one is mounted on the left wrist,
behind a lens that distorts. Exposure drifts, and a forearm and a hand pass below the upper camera.
"""

from collections.abc import Sequence
from dataclasses import replace

import av
import matplotlib.cbook
import mujoco
import numpy as np

from simtune.cameras.distortion import undistort
from simtune.cameras.lens import Lens
from simtune.tasks import Task

WRIST = Lens(
    width=640, height=480, fx=430, fy=430, cx=322, cy=238, distortion=(-0.16, 0.03, 1e-3, -1e-3, 0)
)
WIDTHS = {"top": 480, "wrist": WRIST.width}  # pixels of each camera's pictures, 480 high
_TABLES = """
[[cameras]]
name = "over_the_table"
key = "observation.images.top"
position_m = [0.0, 0.6, 0.8]
look_at_m = [0.0, 0.6, 0.0]
up = [0.0, 1.0, 0.0]
field_of_view_deg = 78
region = {{ left = 128, top = 160, right = 352, bottom = 384, width = 480, height = 480 }}
background = "recording"

[[cameras]]
name = "wrist"
key = "observation.images.wrist"
body = "vx300s_left/gripper_link"
position_m = [-0.03, 0.0, 0.17]
look_at_m = [0.17, 0.0, -0.02]
up = [0.0, 0.0, 1.0]
{lens}
"""
_PINHOLE_DEG = 76.0  # vertical, of the pinhole whose pictures are distorted: it sees more
_TABLE_M = (0.57, 0.37)  # half of the photograph
_ABOVE_M = 0.0015
_NEAREST = 0.005  # of the scene's extent
_DRIFT, _DRIFT_S = 0.12, (1.5, 5.0)
_SKIN, _WIDTH_PX, _PASSES_S = (190, 140, 115), 34, 1.2  # of a forearm


def tuning_file(text: str) -> str:
    """The example's, with both cameras in place of its own."""
    numbers = {n: getattr(WRIST, n) for n in ("fx", "fy", "cx", "cy", "width", "height")}
    listed = ", ".join(f"{name} = {value}" for name, value in numbers.items())
    lens = f"intrinsics = {{ {listed} }}\ndistortion = {list(WRIST.distortion)}"
    return _with_cameras(text, f'{lens}\nbackground = "unknown"')


def filmed_file(text: str) -> str:
    """The same for what films: a pinhole on the wrist that sees more than the lens."""
    return _with_cameras(text, f"field_of_view_deg = {_PINHOLE_DEG}")


def _with_cameras(text: str, lens: str) -> str:
    before, rest = text.split("[camera]\n")
    _, after = rest.split("\n\n", 1)
    return before + _TABLES.format(lens=lens) + "\n" + after


def furnished(task: Task) -> Task:
    """The same task with a photograph on its table."""
    picture = np.ascontiguousarray(_photograph())

    def load_spec() -> mujoco.MjSpec:
        spec = task.load_spec()
        spec.visual.map.znear = _NEAREST  # a real camera sees its own gripper, too
        texture = spec.add_texture(
            name="photograph",
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            width=picture.shape[1],
            height=picture.shape[0],
            nchannel=3,
        )
        texture.data = picture.tobytes()
        material = spec.add_material(name="photograph")
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "photograph"
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[*_TABLE_M, _ABOVE_M / 2],
            pos=[0, 0.6, _ABOVE_M / 2],
            material="photograph",
            contype=0,
            conaffinity=0,
        )
        return spec

    return replace(task, load_spec=load_spec)


def _photograph() -> np.ndarray:
    """(H, W, 3) uint8, wide: the one that comes with matplotlib, lying on its side."""
    with matplotlib.cbook.get_sample_data("grace_hopper.jpg") as file, av.open(file) as container:
        frame = next(container.decode(video=0))
    return np.rot90(frame.to_ndarray(format="rgb24"))


def as_recorded(
    frames: np.ndarray, widths: Sequence[int], step_s: float, rng: np.random.Generator
) -> np.ndarray:
    """(T + 1, 480, W₁ + W₂, 3) drawn frames as both cameras record them."""
    top, wrist = np.split(frames, [widths[0]], -2)
    seconds = np.arange(len(top)) * step_s
    _hand_passes(top, seconds, rng)
    both = (top, _distorted(wrist))
    return np.concatenate([_drifting(its, seconds, rng) for its in both], -2)


def _drifting(frames: np.ndarray, seconds: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Exposure that goes up and down by a tenth or so."""
    phase = rng.uniform(0, 2 * np.pi) + 2 * np.pi * seconds / rng.uniform(*_DRIFT_S)
    gain = np.exp(_DRIFT * np.sin(phase)).astype(np.float32)[:, None, None, None]
    return np.rint(frames * gain).clip(0, 255).astype(np.uint8)


def _hand_passes(frames: np.ndarray, seconds: np.ndarray, rng: np.random.Generator) -> None:
    """A forearm from the lower edge, across the (T, H, W, 3) pictures, in place."""
    height, width = frames.shape[1:3]
    begin = rng.uniform(0, max(seconds[-1] - _PASSES_S, 0.0))
    tip_row = height * rng.uniform(0.4, 0.6)
    rows, columns = np.mgrid[:height, :width]
    for frame, share in zip(frames, (seconds - begin) / _PASSES_S, strict=True):
        if 0 <= share <= 1:
            middle = width * share
            inside = (np.abs(columns - middle) < _WIDTH_PX / 2) & (rows > tip_row)
            inside |= np.hypot(columns - middle, (rows - tip_row) / 1.6) < _WIDTH_PX * 0.7
            shade = 0.75 + 0.25 * np.cos((columns[inside] - middle) / _WIDTH_PX)
            frame[inside] = (shade[:, None] * _SKIN).astype(np.uint8)


def _distorted(frames: np.ndarray) -> np.ndarray:
    """(T, H, W, 3) of the pinhole as the lens shows them, (T, 480, 640, 3)."""
    height, width = frames.shape[1:3]
    pinhole = Lens.pinhole(width, height, _PINHOLE_DEG)
    rows, columns = np.mgrid[: WRIST.height, : WRIST.width]
    seen = np.stack([(columns - WRIST.cx) / WRIST.fx, (rows - WRIST.cy) / WRIST.fy], -1)
    x, y = np.moveaxis(undistort(WRIST.distortion, seen), -1, 0)
    column = np.rint(x * pinhole.fx + pinhole.cx).astype(int)
    row = np.rint(y * pinhole.fy + pinhole.cy).astype(int)
    if min(column.min(), row.min()) < 0 or column.max() >= width or row.max() >= height:
        raise ValueError("the pinhole sees less than the lens")
    return frames[:, row, column]
