"""Actions, readings and cameras from the features in meta/info.json."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.recordings.choosing import choose_camera
from simtune.recordings.lerobot.layout import IMAGES_PREFIX, unexpected
from simtune.recordings.readings import readings_of
from simtune.recordings.source import MOST_ACTIONS, Reading, short

_MAX_LIST_DEPTH = 3  # of lists within lists
_NUMERIC = re.compile(r"u?int\d+|float\d+")  # dtypes
_NO_READINGS = ("action", "timestamp", "frame_index", "episode_index", "index", "task_index")


def action_names(folder: Path, features: dict[str, Any]) -> tuple[str, ...]:
    """Names of an action's numbers. Raises InputError if there are no actions."""
    if "action" not in features:
        raise InputError(
            f"{folder}: no column 'action', and without actions nothing can be replayed; "
            f"there are: {short(list(features))}"
        )
    feature = features["action"] if isinstance(features["action"], dict) else {}
    num = _num_values(feature)
    if num is None:
        expected = f"a shape [A] of 'action' with A from 1 to {MOST_ACTIONS}"
        raise unexpected(folder, expected, feature.get("shape"))
    names = tuple(_names(feature.get("names")))
    return names if len(names) == num else tuple(f"action_{i}" for i in range(num))


def readings(features: dict[str, Any]) -> tuple[Reading, ...]:
    """All numbers stored with each frame, except actions, times and indices."""
    found = []
    for key, feature in features.items():
        num = _num_values(feature) if isinstance(feature, dict) else None
        if (
            num is not None
            and key not in _NO_READINGS
            and _NUMERIC.match(str(feature.get("dtype")))
        ):
            found += readings_of(key, list(_names(feature.get("names"))), num)
    return tuple(found)


def choose_pictures(folder: Path, features: dict[str, Any], camera: str | None) -> tuple[str, bool]:
    """Key of the chosen camera, and whether it has videos; else its pictures are stored one by one.

    Raises InputError if there is no such camera.
    """
    dtypes = {key: f.get("dtype") for key, f in features.items() if isinstance(f, dict)}
    cameras = [key for key, dtype in dtypes.items() if dtype in ("video", "image")]
    if not cameras:
        raise InputError(
            f"{folder}: no camera, that is no feature of dtype 'video' or 'image'; "
            f"there are: {short(list(features))}"
        )
    key = choose_camera(folder, cameras, camera, IMAGES_PREFIX + "{}")
    return key, dtypes[key] == "video"


def _num_values(feature: dict[str, Any]) -> int | None:
    """Number of values per row, for a feature of lists; None for other features."""
    shape = feature.get("shape")
    if not isinstance(shape, list) or len(shape) != 1 or type(shape[0]) is not int:
        return None
    return shape[0] if 0 < shape[0] <= MOST_ACTIONS else None


def _names(names: object, depth: int = _MAX_LIST_DEPTH) -> Iterator[str]:
    """Names in [...], {"motors": [...]}, [[...]] or {name: place}: recorders differ."""
    if isinstance(names, dict):
        are_places = sorted(map(str, names.values())) == sorted(map(str, range(len(names))))
        places = names
        names = sorted(names, key=lambda n: int(places[n])) if are_places else [*names.values()]
    for name in names if isinstance(names, list) else ():
        if not isinstance(name, list | dict):
            yield str(name)
        elif depth:
            yield from _names(name, depth - 1)
