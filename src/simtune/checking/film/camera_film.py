"""What one camera filmed, and the view that the simulator draws beside it."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from simtune.cameras.pictures import resize
from simtune.cameras.views import View, apart
from simtune.observation import ObservationModel

MOST_EPISODES = 3  # whose pictures are compared with the simulator's
MOST_STEPS = 200  # of an episode that are used
_PICTURES, _FEWEST_PICTURES = 24, 8  # in total, and at least per episode


class CameraFilm(NamedTuple):
    """Some frames of some episodes."""

    name: str
    frames: np.ndarray  # (E, K, H, W, 3) uint8
    view: View  # whose plate, if any, is as large as the frames
    is_plate: bool  # whether that plate is the film's own background: only motion can differ
    # {colour: share of the picture that it paints over the plate}
    painted: Mapping[str, float] = MappingProxyType({})


def pictures_of_each(num_episodes: int) -> int:
    """How many frames of each episode are compared."""
    return max(_FEWEST_PICTURES, _PICTURES // max(num_episodes, 1))


def camera_films(seen: ObservationModel, frames: np.ndarray) -> list[CameraFilm]:
    """Each camera's, from (E, K, H, W, 3) frames that show all views side by side."""
    each = apart(frames, [view.width(frames.shape[2]) for view in seen.views()])
    footage = [camera.footage for camera in seen.cameras]
    plates = [f.plate(its, its.shape[2:4]) for f, its in zip(footage, each, strict=True)]
    return [
        CameraFilm(f.name, its, view, f.background == "recording")
        for f, its, view in zip(footage, each, seen.views(plates), strict=True)
    ]


def shrunk(view: View, height: int) -> View:
    """The view with its plate scaled to the height of the simulator's pictures."""
    if view.plate is None:
        return view
    return replace(view, plate=resize(view.plate, (height, view.width(height))))
