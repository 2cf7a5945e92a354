"""What `check` is told about recordings: that they are sound, their actions, films and readings."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.checking.film.as_read import AsRead
from simtune.checking.film.camera_film import (
    MOST_FILMED,
    MOST_FILMED_STEPS,
    camera_films,
    pictures_of_each,
    shrunk,
)
from simtune.checking.film.look import Look, look_at, named_warnings
from simtune.checking.film.picture import draw_film
from simtune.checking.mistakes.lengths import far_beyond_model
from simtune.checking.picture_files import picture_file
from simtune.checking.readings import ReadEpisodes, read_episodes
from simtune.checking.recording_warnings import long_enough, recording_warnings
from simtune.checking.servos.commands import on_tendons
from simtune.checking.servos.picture import draw_servos
from simtune.checking.starts import far_starts
from simtune.columns import cut
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.progress import ReportProgress
from simtune.real.observed import open_recordings
from simtune.real.recorded import how_many
from simtune.recordings import Dataset
from simtune.simulation import Simulator
from simtune.tasks import Task

_COMPARING_S = 60.0  # pictures, moment by moment
_DIVERGING = "the film was not looked at: nearly all of the simulator's worlds diverge"
_MOST_NAMED = 5  # of unsound episodes


class Given(NamedTuple):
    """Episodes to check, and what plays them."""

    simulator: Simulator  # at their rate
    # (E, T, A) of the episodes that are long enough to tune to, cut to the shortest of these
    actions: np.ndarray
    facts: dict[str, Any]  # JSON, with warnings
    read: ReadEpisodes | None = None
    is_far: bool = False  # whether lengths are in another unit than the model's
    recorded_px: int | None = None  # height of recorded pictures


def of_recordings(
    config: CheckConfig,
    task: Task,
    size: int,
    observation: ObservationModel,
    report: ReportProgress,
) -> Given:
    """Looks at actions, films and readings. Raises InputError for unsound recordings.

    Where lengths are in another unit, most else would look wrong and is not compared.
    """
    dataset = open_recordings(config.real or "", task, config, size, observation)
    num = how_many(dataset, config.episodes)
    recorded, frames = look_through(
        dataset, report, min(num, MOST_FILMED) * bool(observation.cameras)
    )
    used = long_enough(recorded[:num], are_filmed=bool(observation.cameras))
    facts: dict[str, Any] = {"recordings": dataset.facts(len(recorded))}
    facts["warnings"] = recording_warnings(task, facts["recordings"], recorded, num)
    heights = [camera["source_size"][0] for camera in facts["recordings"]["cameras"]]
    looked_at = dataset.episodes[: len(frames)]
    films = camera_films(observation.framed(dataset.aspects), frames, looked_at, heights)
    # Supersampled as in tuning: a real camera averages over its pixels.
    simulator = task.simulator(
        image_size=size,
        step_s=dataset.step_s,
        supersampling=observation.supersampling,
        views=[shrunk(film.view, size) for film in films],
    )
    actions = np.stack([actions[: min(map(len, used))] for actions in used])
    if observation.sensors:
        report("looking how joints follow their commands", 0.1)
    read = read_episodes(dataset, num, simulator, observation) if observation.sensors else None
    sensors, values = observation.sensors, read.readings.values if read else None
    far = far_beyond_model(simulator, recorded[:num], sensors, values)
    facts["warnings"] += far
    if observation.cameras and not far:
        budget = Budget(_COMPARING_S, report, span=(0.2, 0.5), prefix="comparing pictures: ")
        as_read = AsRead(simulator, observation, read.trajectories[: len(frames)]) if read else None
        by_name = dict(zip(dataset.episodes, recorded, strict=True))
        looks = look_at(films, simulator, actions, config.seed, as_read, by_name, budget)
        facts["films"] = _drawn(looks, task, config.pictures)
        facts["warnings"] += named_warnings(looks) if looks else [_DIVERGING]
        if values is not None:
            facts["warnings"] += far_starts(simulator, sensors, values, config.seed)
    if read:
        facts["servos"], facts["servos_on_tendons"] = read.facts, on_tendons(simulator)
        facts["warnings"] += read.warnings + (read.misread + read.beyond_ranges) * (not far)
        if read.curves:
            path = picture_file(config.pictures, "-servos" * bool(observation.cameras))
            draw_servos(path, task.name, read.curves, simulator.step_s)
            facts["servo_pictures"] = str(path)
    return Given(simulator, actions, facts, read, bool(far), dataset.recorded_px)


def _drawn(looks: list[Look], task: Task, pictures: Path | None) -> dict[str, Any]:
    """{camera: facts of its film}; JSON. Saves a picture of each."""
    facts = {}
    for look in looks:
        which = f"-{look.film.name.replace('/', '_')}" if len(looks) > 1 else ""
        path = picture_file(pictures, which)
        draw_film(path, task, look.film, look.library, look.comparison, look.warnings)
        facts[look.film.name] = look.facts() | {"pictures": str(path)}
    return facts


def look_through(
    dataset: Dataset, report: ReportProgress, num_looked_at: int = 0
) -> tuple[list[np.ndarray], np.ndarray]:
    """Actions (T, A) of all episodes, after a look at each one's frames, and a few frames.

    The frames are of the first `num_looked_at` episodes, (num_looked_at, K, H, W, 3). Raises
    InputError, after the last episode, if any is unsound, naming the others as well.
    """
    actions, film, faults = [], [], {}
    num_frames = pictures_of_each(num_looked_at)
    for episode, name in enumerate(dataset.episodes):
        report("reading the recordings", episode / len(dataset.episodes))
        try:
            its_actions, frames = dataset.skim(
                episode, num_frames * (episode < num_looked_at), within_steps=MOST_FILMED_STEPS
            )
        except InputError as error:
            faults[name] = str(error)
            continue
        actions.append(its_actions)
        film += [frames] * (episode < num_looked_at)
    if faults:
        first, *others = faults
        more = cut(others, _MOST_NAMED)
        also = f"; {len(others)} more of {dataset.num_episodes} are unsound: {more}"
        raise InputError(faults[first] + also * bool(others))
    return actions, np.stack(film) if film else np.empty((0, 0, 0, 0, 3), np.uint8)
