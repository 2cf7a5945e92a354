"""Looks at what each camera filmed, beside the simulator's pictures."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from simtune.cameras.pictures import resize
from simtune.cameras.views import View, apart
from simtune.checking.film.compare import Comparison, compare
from simtune.checking.film.exchanged import exchanged
from simtune.checking.film.library import Library, make_libraries
from simtune.checking.film.picture import Shown, draw_film, named, new_file
from simtune.checking.film.resting import resting_parts
from simtune.config import CheckConfig
from simtune.observation import ObservationModel
from simtune.simulation import Simulator
from simtune.simulation.rendering.plate import camera_moves
from simtune.tasks import Task

_RESTS = (
    "the background shows what moves: {}, which rests in most frames; when it moves, the simulator "
    "shows it twice: give a picture of the scene without it as background, or record episodes in "
    "which it rests less"
)
_NOT_MODELLED = 'where the room around is not in the model, say background = "unknown"'


class Films(NamedTuple):
    """Each camera's film, (E, K, H, W, 3), and its view with a plate of the same size."""

    names: list[str]
    films: list[np.ndarray]
    views: list[View]
    are_plates: list[bool]  # whether the view's plate is the film's own background

    @classmethod
    def of(cls, seen: ObservationModel, film: np.ndarray) -> "Films":
        """From (E, K, H, W, 3) frames that show all views side by side."""
        films = apart(film, [view.width(film.shape[2]) for view in seen.views()])
        footage = [camera.footage for camera in seen.cameras]
        plates = [f.plate(its, its.shape[2:4]) for f, its in zip(footage, films, strict=True)]
        own = [f.background == "recording" for f in footage]
        return cls([f.name for f in footage], films, seen.views(plates), own)


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
    compared = _compare_all(films, libraries, simulator)
    facts, found = {}, []
    for i, (name, comparison) in enumerate(zip(films.names, compared, strict=True)):
        film, view, library = films.films[i], films.views[i], libraries[i]
        warned = comparison.warnings
        if warned and comparison.is_judged and camera_moves(simulator.model, view.camera):
            warned = [f"{warned[0]}; {_NOT_MODELLED}"]
        if comparison.exchanged_with is None and (rest := resting_parts(simulator, library, i)):
            warned = [*warned, _RESTS.format(", ".join(rest))]
        which = f"-{name.replace('/', '_')}" if len(libraries) > 1 else ""
        if which:
            warned = [f"camera {name}: {warning}" for warning in warned]
        found += warned
        path = named(config.pictures, which) or new_file(which)
        draw_film(path, task, Shown(film, view, library), comparison)
        facts[name] = comparison.facts() | {"pictures": str(path)}
    return facts, found


def _compare_all(films: Films, libraries: list[Library], simulator: Simulator) -> list[Comparison]:
    """Each camera's comparison, and which still cameras' films look exchanged."""
    compared = [
        compare(film, library, is_judged=not view.background_is_unknown, is_plate=is_plate)
        for film, library, view, is_plate in zip(
            films.films, libraries, films.views, films.are_plates, strict=True
        )
    ]
    model = simulator.model
    still = [i for i, view in enumerate(films.views) if not camera_moves(model, view.camera)]
    pairs = exchanged([films.films[i] for i in still], [libraries[i] for i in still])
    for i, j in pairs.items():
        other = films.names[still[j]]
        compared[still[i]] = replace(compared[still[i]], exchanged_with=other)
    return compared
