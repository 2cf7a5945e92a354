"""A PNG of a film beside the simulator's pictures, for people to judge."""

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simtune.cameras.pictures import resize
from simtune.cameras.views import View
from simtune.checking.film.camera_film import CameraFilm
from simtune.checking.film.compare import Comparison
from simtune.checking.film.features import outlines
from simtune.checking.film.film_warnings import all_clear
from simtune.checking.film.library import Library
from simtune.tasks import Task

_HEIGHT_PX = 192  # least height of the pictures
_OUTLINES_PX = 96  # height for outlines: finer detail is mostly texture
_COLUMNS = ("the film", "the simulator, where most alike", "outlines")
_LEGEND = (
    ("white: both", "#6b7075"),
    ("the film only", "#e0301e"),
    ("the simulator only", "#0f9d9d"),
)
_INK, _BAD, _GOOD = "#22262b", "#b3261e", "#1b6e3c"
_WIDTH_IN, _CELL_IN, _HEAD_IN = 9.0, 2.62, 0.72
_FOOT_IN, _LINE_IN = 0.48, 0.15  # below the pictures, without the verdict, and for a line of it
_LINE_CHARACTERS = 105
_LEFT, _RIGHT = 0.11, 0.985


def draw_film(
    path: Path,
    task: Task,
    film: CameraFilm,
    library: Library,
    comparison: Comparison,
    warned: Sequence[str],
) -> None:
    """Save real, simulated and both pictures side by side: some moments, and the background.

    The simulator's are of the library's states nearest to the film's, in the nominal parameters'
    colours.
    """
    frames, view = film.frames, film.view
    height = max(frames.shape[2], _HEIGHT_PX)
    size = height, view.width(height)
    last, middle = len(frames) - 1, frames.shape[1] // 2
    moments = {
        "the first frame": (0, 0),
        "later": (0, middle),
        "another episode" if last else "at the end": (last, middle if last else -1),
    }
    nearest = [int(comparison.nearest[moment]) for moment in moments.values()]
    if view.plate is not None:
        view = replace(view, plate=_brought_to(view.plate, size))
    simulated = _simulated(task, library, nearest, view, height)
    real = [frames[moment] for moment in moments.values()]
    real.append(np.median(frames.reshape(-1, *frames.shape[2:]), 0).astype(np.uint8))
    rows = [(_brought_to(one, size), other) for one, other in zip(real, simulated, strict=True)]
    _save(
        path,
        f"{task.name}, camera {film.view.camera}",
        [*moments, "what stands still"],
        rows,
        *_verdict(film, comparison, warned),
    )


def _simulated(
    task: Task, library: Library, nearest: list[int], view: View, height: int
) -> list[np.ndarray]:
    """Pictures of the library's `nearest` states, and the background in the first one's world."""
    simulator = task.simulator(image_size=height, supersampling=2, views=[view])
    num_kept, size = library.states.shape[1:]
    states = library.states.reshape(-1, size)[nearest]
    drawn = np.concatenate([states, library.states[nearest[0] // num_kept]])
    nominal = np.tile(task.parameters.nominal, (len(drawn), 1))
    frames = simulator.render(drawn, nominal)
    still = np.median(frames[len(states) :], 0).astype(np.uint8)
    return [*frames[: len(states)], still]


def _brought_to(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return resize(picture, size) if len(picture) >= size[0] else _bilinear(picture, size)


def _bilinear(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A picture enlarged to (*size, 3)."""
    enlarged = picture.astype(float)
    for length in size:  # rows, then columns
        own = len(enlarged)
        at = ((np.arange(length) + 0.5) / length * own - 0.5).clip(0, own - 1)
        first = at.clip(0, own - 1 - 1e-6).astype(int)
        upper, lower = enlarged[first], enlarged[np.minimum(first + 1, own - 1)]
        enlarged = upper + (at - first)[:, None, None] * (lower - upper)
        enlarged = np.swapaxes(enlarged, 0, 1)
    return np.rint(enlarged).astype(np.uint8)


def _both(real: np.ndarray, simulated: np.ndarray) -> np.ndarray:
    """(H, W, 3) outlines: white where alike, red the real ones only, cyan the simulated only."""
    small = (_OUTLINES_PX, round(_OUTLINES_PX * real.shape[1] / real.shape[0]))
    one, other = (outlines(resize(picture, small)) for picture in (real, simulated))
    both = np.rint(255 * np.stack([one, other, other], -1)).astype(np.uint8)
    return _bilinear(both, real.shape[:2])


def _save(
    path: Path,
    name: str,
    labels: Sequence[str],
    rows: Sequence[tuple[np.ndarray, np.ndarray]],
    verdict: str,
    colour: str,
) -> None:
    shape, lines = rows[0][0].shape, textwrap.wrap(verdict, _LINE_CHARACTERS)
    foot = _FOOT_IN + _LINE_IN * len(lines)
    height = _HEAD_IN + _CELL_IN * shape[0] / shape[1] * len(rows) + foot
    figure = Figure(figsize=(_WIDTH_IN, height), facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        len(rows), len(_COLUMNS), left=_LEFT, right=_RIGHT, wspace=0.03, hspace=0.03,
        bottom=foot / height, top=1 - _HEAD_IN / height,
    )  # fmt: skip
    for i, (label, (real, simulated)) in enumerate(zip(labels, rows, strict=True)):
        for j, picture in enumerate((real, simulated, _both(real, simulated))):
            axes: Any = figure.add_subplot(grid[i, j])
            axes.imshow(picture, interpolation="bilinear")
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set_visible(False)
            if i == 0:
                axes.set_title(_COLUMNS[j], fontsize=11, color=_INK, pad=5)
            if j == 0:
                axes.set_ylabel(label, fontsize=10, color=_INK, labelpad=6)
    says = f"{name}: the film beside the simulator"
    figure.text(_LEFT, 1 - 0.32 / height, says, fontsize=14, color=_INK, weight="bold")
    _legend(figure, (foot - 0.2) / height)
    figure.text(_LEFT, 0.1 / height, "\n".join(lines), fontsize=9.5, color=colour, va="bottom")
    figure.savefig(path, dpi=110, format="png")


def _legend(figure: Figure, y: float) -> None:
    """Meaning of the outlines' colours, below them."""
    x = _RIGHT
    for says, colour in reversed(_LEGEND):
        figure.text(x, y, says, ha="right", fontsize=9, color=colour, weight="bold")
        x -= 0.012 * len(says) * 0.75 + 0.02


def _verdict(film: CameraFilm, comparison: Comparison, warned: Sequence[str]) -> tuple[str, str]:
    """A sentence, and its colour."""
    if warned:
        return warned[0], _BAD
    return all_clear(film, comparison), _INK if film.is_plate else _GOOD
