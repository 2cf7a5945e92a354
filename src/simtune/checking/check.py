"""`simtune check`, top to bottom."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from simtune.cameras.pictures import resize
from simtune.cameras.views import View, apart
from simtune.checking.conclusions import CLEAR, conclude
from simtune.checking.extents import extents_px, small, unclear_of
from simtune.checking.film.compare import compare
from simtune.checking.film.library import MOST_STEPS, make_libraries
from simtune.checking.film.picture import Shown, draw_film, new_file
from simtune.checking.frictions import unfelt_frictions
from simtune.checking.image_size import choose_image_size
from simtune.checking.limits import joints_at_limits
from simtune.checking.nominal import nominal_states
from simtune.checking.readings import ReadEpisodes, read_episodes, reading_changes
from simtune.checking.recording_warnings import too_short, warnings
from simtune.checking.servos.picture import draw_servos
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.fit.sensitivity import analyze
from simtune.observation import ObservationModel
from simtune.progress import ReportProgress, silent
from simtune.real.observed import observed, open_recordings
from simtune.real.recorded import how_many
from simtune.recordings import Dataset
from simtune.run.files import plain
from simtune.simulation import Simulator
from simtune.simulation.rendering.plate import camera_moves
from simtune.tasks import Task, load_task

_EPISODES = 5
_MOST_NAMED = 5  # of unsound episodes
_LOOKED_AT = 3  # episodes whose pictures are compared
_NOT_MODELLED = 'where the room around is not in the model, say background = "unknown"'
_PICTURES, _FEWEST_PICTURES = 24, 8  # in total, and at least per episode


def check(config: CheckConfig, report: ReportProgress = silent) -> dict[str, Any]:
    """Sensitivity to each parameter, how well it can be found, facts of the recordings; JSON.

    Raises InputError for invalid input.
    """
    config.check()
    task = load_task(config.task)
    seen = observed(task, config.observed, is_simulated=not config.real)
    size = choose_image_size(config, task, "posterior")
    facts: dict[str, Any] = {"task": task.name, "seed": config.seed, "image_size": size}
    facts["warnings"] = []
    read: ReadEpisodes | None = None
    if config.real:
        simulator, actions, read, more = _of_recordings(config, task, size, seen, report)
        facts |= more
    else:
        simulator = task.simulator(image_size=size, views=seen.views())
        num, rng = config.episodes or _EPISODES, np.random.default_rng(config.seed)
        worlds = np.tile(task.parameters.nominal, (num, 1))
        act = simulator.explore(num, task.episode_steps, rng)
        actions = simulator.play(worlds, act, task.episode_steps, rng).actions
        facts["actions"] = "scripted" if task.script else "random"
        facts["warnings"] += too_short(task.episode_steps, are_filmed=bool(seen.cameras))
    readings = None
    if seen.sensors:
        report("replaying readings", 0.5)
        try:
            readings, assumed = reading_changes(simulator, seen, actions, read, config.seed)
        except RuntimeError as error:  # what was found before may say why
            raise InputError("; ".join([*facts["warnings"], str(error)])) from error
        facts["assumed"] = assumed
    sensitivity = analyze(simulator, actions, config.seed, seen, readings, report)
    states = nominal_states(simulator, actions, config.seed)
    facts["warnings"] += joints_at_limits(simulator, states)
    reasons = unfelt_frictions(simulator, states)
    concluded = conclude(task.parameters, sensitivity, reasons)
    if seen.cameras:
        verdicts = {name: its["verdict"] for name, its in concluded["parameters"].items()}
        facts["extents_px"] = extents_px(simulator, states, simulator.views)
        unclear = unclear_of(simulator, verdicts, CLEAR)
        facts["warnings"] += small(facts["extents_px"], size, unclear)
    facts |= {"episodes": len(actions), "steps": actions.shape[1], "step_s": simulator.step_s}
    return plain(facts | concluded)


def _of_recordings(
    config: CheckConfig, task: Task, size: int, seen: ObservationModel, report: ReportProgress
) -> tuple[Simulator, np.ndarray, ReadEpisodes | None, dict[str, Any]]:
    """A simulator at the recordings' rate, their actions (E, T, A), readings, facts and warnings.

    Actions are cut to the shortest episode's.
    """
    dataset = open_recordings(config.real or "", task, config, size, seen)
    num = how_many(dataset, config.episodes)
    recorded, film = look_through(dataset, report, min(num, _LOOKED_AT) * bool(seen.cameras))
    facts: dict[str, Any] = {"recordings": dataset.facts(len(recorded))}
    facts["warnings"] = warnings(task, facts["recordings"], recorded, num)
    films = _Films.of(seen.framed(dataset.aspects), film)
    # Supersampled as in tuning: a real camera averages over its pixels.
    simulator = task.simulator(
        image_size=size,
        step_s=dataset.step_s,
        supersampling=seen.supersampling,
        views=[_shrunk(view, size) for view in films.views],
    )
    steps = min(len(actions) for actions in recorded[:num])
    actions = np.stack([actions[:steps] for actions in recorded[:num]])
    if seen.cameras:
        report("comparing pictures", 0.0)
        facts["films"], more = _look_at(films, task, simulator, actions, config)
        facts["warnings"] += more
    read = None
    if seen.sensors:
        read = read_episodes(dataset, num, simulator, seen)
        facts["servos"] = read.facts
        facts["warnings"] += read.warnings
        if read.curves:
            path = _beside(config.pictures, bool(seen.cameras)) or new_file()
            draw_servos(path, task.name, read.curves, simulator.step_s)
            facts["servo_pictures"] = str(path)
    return simulator, actions, read, facts


def _beside(pictures: Path | None, is_taken: bool) -> Path | None:
    """Where joints are drawn, if the pictures' file is said, which a film may have taken."""
    return _named(pictures, "-servos" * is_taken)


def _named(pictures: Path | None, which: str) -> Path | None:
    return pictures and pictures.with_stem(pictures.stem + which)


class _Films(NamedTuple):
    """Each camera's film, (E, K, H, W, 3), and its view with a plate of the same size."""

    names: list[str]
    films: list[np.ndarray]
    views: list[View]

    @classmethod
    def of(cls, seen: ObservationModel, film: np.ndarray) -> "_Films":
        """From (E, K, H, W, 3) frames that show all views side by side."""
        films = apart(film, [view.width(film.shape[2]) for view in seen.views()])
        footage = [camera.footage for camera in seen.cameras]
        plates = [f.plate(its, its.shape[2:4]) for f, its in zip(footage, films, strict=True)]
        return cls([f.name for f in footage], films, seen.views(plates))


def _shrunk(view: View, height: int) -> View:
    """The view with its plate scaled to the height of the simulator's pictures."""
    if view.plate is None:
        return view
    return replace(view, plate=resize(view.plate, (height, view.width(height))))


def _look_at(
    films: _Films, task: Task, simulator: Simulator, actions: np.ndarray, config: CheckConfig
) -> tuple[dict[str, Any], list[str]]:
    """Facts of each camera's film, by name, and warnings; saves pictures."""
    libraries = make_libraries(simulator, actions[:_LOOKED_AT], config.seed)
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
        path = _named(config.pictures, which) or new_file(which)
        draw_film(path, task, Shown(film, view, library), comparison)
        facts[name] = comparison.facts() | {"pictures": str(path)}
    return facts, found


def look_through(
    dataset: Dataset, report: ReportProgress, num_looked_at: int = 0
) -> tuple[list[np.ndarray], np.ndarray]:
    """Actions (T, A) of all episodes, after a look at each one's frames, and a few frames.

    The frames are of the first `num_looked_at` episodes, (num_looked_at, K, H, W, 3). Raises
    InputError, after the last episode, if any is unsound, naming the others as well.
    """
    actions, film, faults = [], [], {}
    num_frames = max(_FEWEST_PICTURES, _PICTURES // max(num_looked_at, 1))
    for episode, name in enumerate(dataset.episodes):
        report("reading the recordings", episode / len(dataset.episodes))
        try:
            its_actions, frames = dataset.skim(
                episode, num_frames * (episode < num_looked_at), within_steps=MOST_STEPS
            )
        except InputError as error:
            faults[name] = str(error)
            continue
        actions.append(its_actions)
        film += [frames] * (episode < num_looked_at)
    if faults:
        first, *others = faults
        more = ", ".join(others[:_MOST_NAMED]) + ", ..." * (len(others) > _MOST_NAMED)
        also = f"; {len(others)} more of {dataset.num_episodes} are unsound: {more}"
        raise InputError(faults[first] + also * bool(others))
    return actions, np.stack(film) if film else np.empty((0, 0, 0, 0, 3), np.uint8)
