"""A camera's recordings in a tuning file: video key, lens, background, latency."""

import json
from pathlib import Path
from typing import Any

import yaml

from simtune.cameras.footage import Footage
from simtune.cameras.lens import Lens
from simtune.errors import InputError
from simtune.toml_reading import TomlTable
from simtune.validate import is_number

KEYS = ("key", "background", "intrinsics", "distortion", "calibration", "region", "latency_s")
_NO_DISTORTION = (0.0,) * 5
_FEWEST_COEFFICIENTS, _COEFFICIENTS = 4, 5  # k3 may be left out


def read_footage(table: TomlTable) -> Footage:
    """Read the recordings of [camera], or of one of [[cameras]]. Raises InputError."""
    return Footage(
        key=table.text("key", None),
        lens=_lens(table),
        background=_background(table),
        latency_s=table.number("latency_s", 0.0, least=0, most=1),
    )


def _background(table: TomlTable) -> Any:
    background = table.text("background", None)
    if background in (None, "recording", "unknown"):
        return background
    path = table.file.parent / background
    if not path.is_file():
        raise table.error(
            f'background = "{background}": no such file beside {table.file.name}; expected a '
            'picture by this camera, "recording" or "unknown"',
            "background",
        )
    return path


def _lens(table: TomlTable) -> Lens | None:
    if "calibration" in table:
        if "intrinsics" in table or "distortion" in table:
            raise table.error("give calibration, or intrinsics and distortion", "calibration")
        with table.at("calibration"):
            lens = read_calibration(table.file.parent / table.text("calibration"))
        key = "calibration"
    elif "intrinsics" in table:
        given = table.table("intrinsics")
        given.allow("fx", "fy", "cx", "cy", "width", "height")
        sizes = {key: given.whole(key) for key in ("width", "height")}
        focal = {key: given.number(key, above=0) for key in ("fx", "fy")}
        middle = {key: given.number(key) for key in ("cx", "cy")}
        distortion = table.numbers("distortion", _COEFFICIENTS, _NO_DISTORTION)
        lens, key = Lens(**sizes, **focal, **middle, distortion=tuple(distortion)), "intrinsics"
    elif "distortion" in table:
        raise table.error("distortion goes with intrinsics = { fx, fy, cx, cy, ... }", "distortion")
    else:
        return None
    with table.at(key):
        lens.check()
    return lens


def read_calibration(path: Path) -> Lens:
    """Read OpenCV's FileStorage or ROS's camera_info, as YAML or JSON.

    Raises InputError for anything else.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', 'no text')}") from None
    try:
        content = json.loads(text) if path.suffix == ".json" else _yaml(text)
    except (ValueError, yaml.YAMLError) as error:
        raise InputError(f"{path}: not valid: {str(error).splitlines()[0]}") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected a calibration with image_width and camera_matrix")
    matrix = _matrix(path, content, ("camera_matrix", "cameraMatrix", "K", "k"))
    coefficients = _matrix(
        path, content, ("distortion_coefficients", "dist_coeffs", "distCoeffs", "D", "d")
    )
    model = content.get("distortion_model", "plumb_bob")
    if content.get("fisheye_model"):
        raise InputError(
            f"{path}: of a fisheye lens, whose numbers mean something else; calibrate with k1, k2, "
            "p1, p2, k3, or undistort the film first"
        )
    if len(matrix) != 9 or model != "plumb_bob" or len(coefficients) < _FEWEST_COEFFICIENTS:
        raise InputError(
            f"{path}: expected a camera matrix of 3 × 3 numbers and k1, k2, p1, p2, k3 "
            f"(distortion_model plumb_bob), got {len(matrix)} and {len(coefficients)} numbers, "
            f"{model!r}"
        )
    if any(coefficients[_COEFFICIENTS:]):
        raise InputError(f"{path}: calibrate with k1, k2, p1, p2, k3 alone, not a rational model")
    k1, k2, p1, p2, k3 = (*coefficients, 0.0)[:_COEFFICIENTS]
    width, height = (_size(path, content, name) for name in ("width", "height"))
    fx, _, cx, _, fy, cy = matrix[:6]
    if not (fx > 0 and fy > 0):
        raise InputError(
            f"{path}: expected focal lengths above 0 pixels, got fx = {fx:g} and fy = {fy:g}; "
            "all 0 means that the camera was never calibrated: calibrate it, or leave this out"
        )
    return Lens(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))


def _yaml(text: str) -> Any:
    """Parse YAML; OpenCV's first line, which is not YAML, and its own tag are removed."""
    lines = text.splitlines()
    if lines and lines[0].startswith("%YAML:"):
        lines = lines[1:]
    return yaml.safe_load("\n".join(lines).replace("!!opencv-matrix", ""))


def _matrix(path: Path, content: dict, names: tuple[str, ...]) -> list[float]:
    """The numbers, row by row, of the first of `names` that `content` has."""
    value = next((content[name] for name in names if name in content), None)
    if isinstance(value, dict):
        value = value.get("data")
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        value = [number for row in value for number in row]
    if not isinstance(value, list) or not all(map(is_number, value)):
        raise InputError(f"{path}: expected {names[0]}, a list of numbers")
    return [float(number) for number in value]


def _size(path: Path, content: dict, name: str) -> int:
    value = content.get(f"image_{name}", content.get(name))
    if not is_number(value) or not isinstance(value, int) or value < 1:
        raise InputError(f"{path}: expected image_{name}, pixels; got {value!r:.60}")
    return value
