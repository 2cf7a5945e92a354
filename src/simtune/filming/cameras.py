"""What a recording's cameras show, and under which names."""

from dataclasses import replace

import mujoco

from simtune.cameras.lens import Lens
from simtune.cameras.rectify import SHAPE
from simtune.cameras.views import View
from simtune.config import RecordConfig
from simtune.errors import InputError
from simtune.recordings.lerobot.layout import IMAGES_PREFIX
from simtune.simulation import Simulator
from simtune.tasks import Task


def views_of(config: RecordConfig, task: Task) -> list[View]:
    """What the cameras film, before the pictures that the tuning file names as backgrounds.

    Raises InputError like `_aspect`, and for a picture that cannot be drawn.
    """
    size, views = config.image_size, []
    for footage in task.cameras:
        view = View(footage.camera, _aspect(config, footage.lens))
        # All of the picture: readers look at the region, see `filming_whole`.
        plate = replace(footage, lens=None).picture((size, view.width(size)))
        if plate is not None and config.renderer == "opengl":
            raise InputError(
                f"{footage.background}: OpenGL cannot draw a background picture: leave --renderer "
                "opengl out, or record with a copy of the tuning file without background"
            )
        views.append(replace(view, plate=plate))
    return views


def _aspect(config: RecordConfig, lens: Lens | None) -> float:
    """Width over height of what is filmed, an even number of pixels wide.

    Raises InputError if these are not of a lens's shape, and would not be read as its pictures.
    """
    size = config.image_size
    if lens is None:
        return (config.width or size) / size
    width = config.width or 2 * round(size * lens.width / lens.height / 2)
    if abs(width / size - lens.width / lens.height) > SHAPE:
        raise InputError(
            f"pictures of {width}×{size} pixels are of another shape than those that the tuning "
            f"file names, {lens.width}×{lens.height}; leave --width out, and give an --image-size "
            "of 128 or more"
        )
    return width / size


def filming_whole(task: Task) -> Task:
    """The same task with cameras that see whole pictures, not only regions.

    So readers apply the region once. Raises InputError for a lens that distorts or looks aside:
    pictures are drawn through pinholes.
    """
    lenses = {footage.camera: footage.lens for footage in task.cameras if footage.lens}
    for name, lens in lenses.items():
        if not lens.is_pinhole:
            raise InputError(
                f"camera {name} of {task.name} has a lens, and pictures are drawn without one: "
                "record with a copy of the tuning file without intrinsics, distortion, calibration"
            )

    def load_spec() -> mujoco.MjSpec:
        spec = task.load_spec()
        for name, lens in lenses.items():
            given = spec.camera(name)
            given.quat, given.fovy = lens.from_region(given.quat), lens.whole_fovy_deg
        return spec

    return replace(task, load_spec=load_spec) if lenses else task


def widths_of(task: Task, simulator: Simulator) -> dict[str, int] | None:
    """{camera: pixels}, by the names under which they are read; None if one has no such name."""
    names = [footage.key or footage.name for footage in task.cameras]
    if len(names) == 1 and task.cameras[0].key is None:
        return None
    names = [name.removeprefix(IMAGES_PREFIX) for name in names]
    return dict(zip(names, simulator.widths, strict=True))
