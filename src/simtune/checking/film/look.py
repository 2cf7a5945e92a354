"""Looks at what each camera filmed, beside the simulator's pictures."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from simtune.cameras.pictures import resize
from simtune.cameras.views import View, apart
from simtune.checking.film.compare import compare
from simtune.checking.film.library import make_libraries
from simtune.checking.film.picture import Shown, draw_film, named, new_file
from simtune.config import CheckConfig
from simtune.observation import ObservationModel
from simtune.simulation import Simulator
from simtune.simulation.rendering.plate import camera_moves
from simtune.tasks import Task

_NOT_MODELLED = 'where the room around is not in the model, say background = "unknown"'


class Films(NamedTuple):
    """Each camera's film, (E, K, H, W, 3), and its view with a plate of the same size."""

    names: list[str]
    films: list[np.ndarray]
    views: list[View]

    @classmethod
    def of(cls, seen: ObservationModel, film: np.ndarray) -> "Films":
        """From (E, K, H, W, 3) frames that show all views side by side."""
        films = apart(film, [view.width(film.shape[2]) for view in seen.views()])
        footage = [camera.footage for camera in seen.cameras]
        plates = [f.plate(its, its.shape[2:4]) for f, its in zip(footage, films, strict=True)]
        return cls([f.name for f in footage], films, seen.views(plates))


def shrunk(view: View, height: int) -> View:
    """The view with its plate scaled to the height of the simulator's pictures."""
    if view.plate is None:
        return view
    return replace(view, plate=resize(view.plate, (height, view.width(height))))


def look_at(
    films: Films, task: Task, simulator: Simulator, actions: np.ndarray, config: CheckConfig
) -> tuple[dict[str, Any], list[str]]:
    """Facts of each camera's film, by name, and warnings; saves pictures."""
    libraries = make_libraries(simulator, actions[: len(films.films[0])], config.seed)
    if not libraries:
        return {}, ["the film was not looked at: nearly all of the simulator's worlds diverge"]
    facts, found = {}, []
    for name, library, film, view in zip(
        films.names, libraries, films.films, films.views, strict=True
    ):
        comparison = compare(film, library, is_judged=not view.background_is_unknown)
        warned = comparison.warnings
        if warned and comparison.is_judged and camera_moves(simulator.model, view.camera):
            warned = [f"{warned[0]}; {_NOT_MODELLED}"]
        which = f"-{name.replace('/', '_')}" if len(libraries) > 1 else ""
        if which:
            warned = [f"camera {name}: {warning}" for warning in warned]
        found += warned
        path = named(config.pictures, which) or new_file(which)
        draw_film(path, task, Shown(film, view, library), comparison)
        facts[name] = comparison.facts() | {"pictures": str(path)}
    return facts, found
