"""What one camera filmed, and the view that the simulator draws beside it."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from simtune.cameras.views import View, apart
from simtune.observation import ObservationModel


class CameraFilm(NamedTuple):
    """Some frames of some episodes."""

    name: str
    frames: np.ndarray  # (E, K, H, W, 3) uint8
    view: View  # whose plate, if any, is as large as the frames
    is_plate: bool  # whether that plate is the film's own background: only motion can differ
    # {colour: share of the picture that it paints over the plate}
    painted: Mapping[str, float] = MappingProxyType({})


def camera_films(seen: ObservationModel, frames: np.ndarray) -> list[CameraFilm]:
    """Each camera's, from (E, K, H, W, 3) frames that show all views side by side."""
    each = apart(frames, [view.width(frames.shape[2]) for view in seen.views()])
    footage = [camera.footage for camera in seen.cameras]
    plates = [f.plate(its, its.shape[2:4]) for f, its in zip(footage, each, strict=True)]
    return [
        CameraFilm(f.name, its, view, f.background == "recording")
        for f, its, view in zip(footage, each, seen.views(plates), strict=True)
    ]
