"""A region of interest: a camera's part of a picture, as another camera at its place sees it."""

import json
from dataclasses import replace
from typing import Any

import mujoco

from simtune.errors import InputError
from simtune.lens import Lens
from simtune.tasks.tuning_file.toml_table import TomlTable


def read_region(table: TomlTable, lens: Lens | None, fovy_deg: float) -> Lens | None:
    """The lens that looks at a region alone, where there is one; without a lens, a pinhole's."""
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
    """A camera of the model, wherever it is mounted, so that it looks at the lens's region.

    Its field of view is the caller's to set. A model that was tuned and exported says that it was
    turned already. Raises InputError where that was to another region, and for a camera that turns
    by itself.
    """
    if lens.region is None:
        return
    known = _known(spec, name)
    if known:
        if known["region"] != list(lens.region):
            raise InputError(f"camera {name} of the model looks at region {known['region']} only")
        return
    before, its = spec.camera(name), spec.compile().camera(name)
    if its.mode[0] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        raise InputError(f"camera {name} turns by itself: a region needs one that is fixed")
    known, body = {"region": lens.region, "fovy_deg": float(before.fovy)}, before.parent
    spec.delete(before)
    body.add_camera(name=name, pos=its.pos, quat=lens.towards_region(its.quat))
    spec.add_text(name=_text(name), data=json.dumps(known))


def own_fovy_deg(spec: mujoco.MjSpec, name: str) -> float:
    """A camera's vertical field of view, before it looked at a region only."""
    known = _known(spec, name)
    return float(known["fovy_deg"] if known else spec.camera(name).fovy)


def _known(spec: mujoco.MjSpec, name: str) -> dict[str, Any]:
    """What a model says of a camera that was turned; nothing where it was not."""
    texts = {text.name: text.data for text in spec.texts}
    return json.loads(texts.get(_text(name), "{}"))


def _text(name: str) -> str:
    return f"{name} looks at a region"
