"""A region of interest: a part of a camera's picture, seen by a virtual camera at its place."""

import json
from dataclasses import replace
from typing import Any

import mujoco

from simtune.cameras.lens import Lens
from simtune.errors import InputError
from simtune.tasks.tuning_file.camera_sensor import add_plain_camera
from simtune.toml_reading import TomlTable


def read_region(table: TomlTable, lens: Lens | None, fovy_deg: float) -> Lens | None:
    """The lens restricted to the table's region, if it has one; the default is a pinhole's."""
    if "region" not in table:
        return lens
    given, sizes = table.table("region"), ("width", "height")
    given.allow("left", "top", "right", "bottom", *(() if lens else sizes))
    if lens is None:
        width, height = (given.whole(key) for key in sizes)
        lens = Lens.pinhole(width, height, fovy_deg)
    left, top, right, bottom = (given.number(k) for k in ("left", "top", "right", "bottom"))
    lens = replace(lens, region=(left, top, right, bottom))
    with table.at("region"):
        lens.check()
    return lens


def turn(spec: mujoco.MjSpec, name: str, lens: Lens) -> None:
    """Turn a camera of the model, wherever it is mounted, so that it looks at the lens's region.

    The caller sets its field of view. A tuned and exported model notes that its camera is turned
    already. Raises InputError if it was turned to another region, or if the camera is not fixed.
    """
    if lens.region is None:
        return
    known = _known(spec, name)
    if known:
        if known["region"] != list(lens.region):
            raise InputError(f"camera {name} of the model looks at region {known['region']} only")
        return
    before, compiled = spec.camera(name), spec.compile().camera(name)
    if compiled.mode[0] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        raise InputError(f"camera {name} turns by itself: a region needs one that is fixed")
    known, body = {"region": lens.region, "fovy_deg": float(before.fovy)}, before.parent
    spec.delete(before)
    add_plain_camera(body, name, compiled.pos, lens.towards_region(compiled.quat))
    spec.add_text(name=_text(name), data=json.dumps(known))


def own_fovy_deg(spec: mujoco.MjSpec, name: str) -> float:
    """A camera's vertical field of view, before it was turned to a region."""
    known = _known(spec, name)
    return float(known["fovy_deg"] if known else spec.camera(name).fovy)


def _known(spec: mujoco.MjSpec, name: str) -> dict[str, Any]:
    """The model's note about a turned camera; empty if it was not turned."""
    texts = {text.name: text.data for text in spec.texts}
    return json.loads(texts.get(_text(name), "{}"))


def _text(name: str) -> str:
    return f"{name} looks at a region"
