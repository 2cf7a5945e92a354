"""Output on a camera that was found."""

import json
from typing import Any

import numpy as np

from simtune.camera_pose.found import FoundCamera
from simtune.camera_pose.sureness import half_widths, is_by_chance
from simtune.parameters import ModelWriter
from simtune.run.files import plain
from simtune.tasks import Task

_AT_END_SHARE = 0.01  # of the range


def describe(task: Task, found: FoundCamera, num_frames: int) -> dict[str, Any]:
    """JSON of a camera."""
    space, unit = task.parameters, found.fit.unit
    reach = half_widths(found)
    mean, low, high = (space.from_unit(np.clip(unit + sign * reach, 0, 1)) for sign in (0, -1, 1))
    model = task.load_model()
    ModelWriter(space, model).write(model, mean)
    given, lens = model.camera(task.cameras[0].camera), task.cameras[0].lens
    # A calibration defines the field of view, and a camera in the world needs no body.
    where: dict[str, Any] = {}
    if lens is None or not lens.is_calibrated:
        fovy_deg = lens.whole_fovy_deg if lens else float(given.fovy[0])
        where["field_of_view_deg"] = round(fovy_deg, 6)
    if given.bodyid[0]:
        where["body"] = model.body(given.bodyid[0]).name
    parameters = {
        p.name: {"unit": p.unit, "mean": mean[i], "low": low[i], "high": high[i]}
        for i, p in enumerate(space)
    }
    return plain(
        {
            "camera": task.cameras[0].name,
            "is_found": not is_by_chance(found.agreement),
            "position_m": given.pos.tolist(),
            "quat": lens.from_region(given.quat) if lens else given.quat.tolist(),
            **where,
            "parameters": parameters,
            "frames": num_frames,
            "warnings": _warnings(task, found),
        }
    )


def _warnings(task: Task, found: FoundCamera) -> list[str]:
    said, unit = [], found.fit.unit
    if is_by_chance(found.agreement):
        said.append(
            "the robot's edges are not on the film's: this is not the camera. Are the readings "
            "those of the frames, and does the model look like the robot? Else give a nearer "
            "guess, a wider range (--within-m, --within-deg, --within-fov-deg) or more time "
            "(--budget-minutes)"
        )
    for i, parameter in enumerate(task.parameters):
        if not _AT_END_SHARE < unit[i] < 1 - _AT_END_SHARE:
            said.append(
                f"{parameter.name} is at the end of what was searched: give a nearer guess, or a "
                "wider range (--within-m, --within-deg, --within-fov-deg)"
            )
    return said


def lines(result: dict[str, Any], path: object) -> list[str]:
    """Lines to print; `path`: of the file that a camera that is found is written to."""
    rows = [
        f"{name:22s} {p['mean']:10.4g} {p['unit']:4s} {p['low']:.4g} to {p['high']:.4g}"
        for name, p in result["parameters"].items()
    ]
    said = f"camera {result['camera']}, by {result['frames']} frames"
    end = f"written to {path}" if result["is_found"] else f"not found: nothing is written to {path}"
    return [said, *rows, *(f"warning: {w}" for w in result["warnings"]), end]


def tuning_table(result: dict[str, Any]) -> str:
    """The pose as in a tuning file."""
    keys = ("body", "position_m", "quat", "field_of_view_deg")
    rows = [f"{key} = {json.dumps(result[key])}" for key in keys if key in result]
    return "\n".join(["[camera]", *rows, ""])
