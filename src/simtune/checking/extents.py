"""Size of moving bodies in pictures: a detector learns little from a few pixels."""

import math
from collections.abc import Collection, Mapping, Sequence

import mujoco
import numpy as np

from simtune.before_after.moving_parts import part_name
from simtune.cameras.views import View
from simtune.config import LARGEST_PX
from simtune.parameters import Parameter
from simtune.simulation import Simulator
from simtune.vision.corners import corners_of_parts, vertices_of_flexes
from simtune.vision.keypoints import Keypoints

_STEPS, _EPISODES = 12, 4  # used at most
FEW_PX, _ENOUGH_PX = 3.5, 5.0  # across: at an accuracy of about 0.2 pixels, a size is known to 5 %
OUT_OF_SIGHT_PX, _FEWEST_PX = 0.05, 0.1
_MIN_IN_SIGHT_SHARE = 0.1  # of the states
_NOTHING = (
    "nothing that moves is in sight, in most of these worlds: correct the camera's pose, or cut "
    "recordings where it has left the picture"
)
_MULTIPLE_PX = 8  # of a proposed height
_OWNERS = {"geom": "geom_bodyid", "jnt": "jnt_bodyid", "dof": "jnt_bodyid", "site": "site_bodyid"}


def extents_px(simulator: Simulator, states: np.ndarray, views: Sequence[View]) -> dict[str, float]:
    """{body or flex: pixels} across the narrow side of what moves, where that is largest.

    In the view that shows it so: median over those of some of the (E, T + 1, S) states of nominal
    worlds in which it is in sight; 0 if these are few.
    """
    at = np.linspace(0, states.shape[1] - 1, min(_STEPS, states.shape[1])).astype(int)
    some = states[:_EPISODES, at].reshape(-1, states.shape[2])
    found: dict[str, float] = {}
    for (body, _), pixels in corners_px(simulator, some, views).items():
        name = part_name(simulator.model, body)
        found[name] = max(found.get(name, 0.0), _median_in_sight(across(pixels)))
    return found | _flexes_px(simulator, some, views)


def _flexes_px(simulator: Simulator, states: np.ndarray, views: Sequence[View]) -> dict[str, float]:
    """{flex: pixels}, as `extents_px`, in (n, S) states."""
    found = {}
    flexes = vertices_of_flexes(simulator.model, views, simulator.image_size)
    for name, vertices in flexes.items():
        pixels = _pixels(simulator, states, vertices)
        each = (pixels[:, vertices.views == view] for view in range(len(views)))
        found[name] = max((_median_in_sight(across(points)) for points in each), default=0.0)
    return found


def _median_in_sight(sizes: np.ndarray) -> float:
    """Of (n,) pixels: a ball that has rolled out of the picture was no smaller in it."""
    in_sight = sizes > OUT_OF_SIGHT_PX
    return float(np.median(sizes[in_sight])) if in_sight.mean() > _MIN_IN_SIGHT_SHARE else 0.0


def corners_px(
    simulator: Simulator, states: np.ndarray, views: Sequence[View]
) -> dict[tuple[int, int], np.ndarray]:
    """{(body, index of the view): (n, L, 2) pixels of the corners of its geoms}, in (n, S) states.

    Of nominal worlds, and of what moves before a view's camera.
    """
    corners = corners_of_parts(simulator.model, views, simulator.image_size)
    if not len(corners):
        return {}
    pixels = _pixels(simulator, states, corners)
    model = simulator.model
    bodies = model.body_weldid[model.geom_bodyid[corners.geoms]]
    pairs = sorted(set(zip(bodies.tolist(), corners.views.tolist(), strict=True)))
    return {
        (body, view): pixels[:, (bodies == body) & (corners.views == view)] for body, view in pairs
    }


def _pixels(simulator: Simulator, states: np.ndarray, points: Keypoints) -> np.ndarray:
    """(n, L, 2) of points in (n, S) states of nominal worlds."""
    worlds = np.tile(simulator.space.nominal, (len(states), 1))
    rng = np.random.default_rng(0)
    seen = simulator.begin(worlds, rng, starts=states, observe=points.observe).observed
    return seen.reshape(-1, len(points), 2).astype(float)


def small_in_pictures(
    extents: dict[str, float],
    image_size: int,
    unclear: Mapping[str, Collection[str]],
    recorded_px: int | None = None,
) -> list[str]:
    """Warnings if even the largest moving body is small, or a body with an unclear parameter.

    `unclear`: {body: its parameters that do not show clearly}; `recorded_px`: height of recorded
    pictures, None if there are none.
    """
    if not extents:
        return []
    largest = max(extents, key=lambda name: extents[name])
    if extents[largest] <= OUT_OF_SIGHT_PX:
        return [_NOTHING]
    if extents[largest] < FEW_PX:
        what_is = f"what moves is small: the largest, {largest}, is"
        return [_few_pixels(what_is, extents[largest], image_size, recorded_px)]
    return [
        _few_pixels(f"{', '.join(names)}: {body} is", extents[body], image_size, recorded_px)
        for body, names in unclear.items()
        if OUT_OF_SIGHT_PX < extents.get(body, 0.0) < FEW_PX
    ]


def enough_size(pixels: float, image_size: int) -> int:
    """Height of pictures that show enough of an object with `pixels` at `image_size`."""
    return _MULTIPLE_PX * math.ceil(
        _ENOUGH_PX / max(pixels, _FEWEST_PX) * image_size / _MULTIPLE_PX
    )


def _few_pixels(what_is: str, pixels: float, image_size: int, recorded_px: int | None) -> str:
    larger = min(enough_size(pixels, image_size), recorded_px or LARGEST_PX, LARGEST_PX)
    ways = ["film it from nearer by"]
    if recorded_px is None or recorded_px > LARGEST_PX:
        ways.insert(0, "look at a region of the recordings alone, [camera] region = ...")
    if larger > image_size:
        shows = f"--image-size {larger} would show {pixels * larger / image_size:.1f}"
        ways.insert(0, shows + ", if the recordings have as many" * (recorded_px is None))
    return f"{what_is} {pixels:.1f} of {image_size} pixels across. {'; or '.join(ways)}"


def unclear_of(
    simulator: Simulator, verdicts: Mapping[str, str], clear: str
) -> dict[str, list[str]]:
    """{body: parameters of it, or of its geoms, whose verdict is not `clear`}."""
    found: dict[str, list[str]] = {}
    for parameter in simulator.space.parameters:
        if verdicts[parameter.name] == clear:
            continue
        for body in _bodies(simulator.model, parameter):
            found.setdefault(body, []).append(parameter.name)
    return found


def _bodies(model: mujoco.MjModel, parameter: Parameter) -> list[str]:
    """Names as in `extents_px`; empty for a parameter of no body and no geom."""
    if parameter.field_info.prefix not in ("body", "geom"):
        return []
    bodies = model.body_weldid[bodies_of(model, parameter)]
    return sorted({part_name(model, body) for body in bodies.tolist()})


def bodies_of(model: mujoco.MjModel, parameter: Parameter) -> list[int]:
    """Indices of the bodies that a parameter's objects are or are of; empty for one of no body."""
    prefix, kind = parameter.field_info.prefix, parameter.field_info.object_type
    if kind is None or prefix not in (*_OWNERS, "body"):
        return []
    ids = [mujoco.mj_name2id(model, kind.mjt, name) for name in parameter.objects]
    return ids if prefix == "body" else getattr(model, _OWNERS[prefix])[ids].tolist()


def across(pixels: np.ndarray) -> np.ndarray:
    """(n,) extent of (n, L, 2) points along their shortest principal axis."""
    away = pixels - pixels.mean(1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nli,nlj->nij", away, away))
    return np.ptp(np.einsum("nli,ni->nl", away, axes[:, :, 0]), axis=1)
