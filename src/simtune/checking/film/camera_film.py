"""What one camera filmed, and the view that the simulator draws beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from simtune.cameras.pictures import resize
from simtune.cameras.views import View, apart
from simtune.checking.film.features import squeezed
from simtune.observation import ObservationModel

MOST_FILMED = 3  # whose pictures are compared with the simulator's
MOST_FILMED_STEPS = 200  # of an episode that are used
_PICTURES, _FEWEST_PICTURES = 24, 8  # in total, and at least per episode


@dataclass(frozen=True)
class CameraFilm:
    """Some frames of some episodes."""

    name: str
    frames: np.ndarray  # (E, K, H, W, 3) uint8
    view: View  # whose plate, if any, is as large as the frames
    is_plate: bool  # whether that plate is the film's own background: only motion can differ
    # {colour: share of the picture that it paints over the plate}
    painted: Mapping[str, float] = field(default_factory=dict)
    episodes: Sequence[str] = ()  # (E,) names
    own_px: int | None = None  # height of the whole pictures as recorded; None: unknown, or a part

    @cached_property
    def squares(self) -> np.ndarray:
        """(E, K, SIZE, SIZE, 3) of the frames."""
        return squeezed(self.frames)


def pictures_of_each(num_episodes: int) -> int:
    """How many frames of each episode are compared."""
    return max(_FEWEST_PICTURES, _PICTURES // max(num_episodes, 1))


def camera_films(
    observation: ObservationModel,
    frames: np.ndarray,
    episodes: Sequence[str],
    own_px: Sequence[int] = (),
) -> list[CameraFilm]:
    """Each camera's, from (E, K, H, W, 3) frames that show all views side by side.

    `episodes`: the names of these. `own_px`: how high each camera's pictures are as recorded; by
    default unknown.
    """
    each = apart(frames, [view.width(frames.shape[2]) for view in observation.views()])
    footage = [camera.footage for camera in observation.cameras]
    plates = [f.plate(film, film.shape[2:4]) for f, film in zip(footage, each, strict=True)]
    films = [
        CameraFilm(f.name, film, view, f.background == "recording", episodes=episodes)
        for f, film, view in zip(footage, each, observation.views(plates), strict=True)
    ]
    for i, height in enumerate(own_px):
        if not footage[i].lens:  # which shows a part, or another scale
            films[i] = replace(films[i], own_px=height)
    return films


def shrunk(view: View, height: int) -> View:
    """The view with its plate scaled to the height of the simulator's pictures."""
    if view.plate is None:
        return view
    return replace(view, plate=resize(view.plate, (height, view.width(height))))
