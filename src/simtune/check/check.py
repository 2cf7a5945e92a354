"""`simtune check`, top to bottom."""

from typing import Any

import numpy as np

from simtune.check.conclusions import conclude
from simtune.check.recording_warnings import warnings
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.fit.sensitivity import analyze
from simtune.observation import ObservationModel
from simtune.progress import ReportProgress, silent
from simtune.real.choose import open_recordings
from simtune.real.recorded import how_many
from simtune.recordings import Dataset
from simtune.tasks import load_task
from simtune.tuning import needed_image_size

_EPISODES = 5
_MOST_NAMED = 5  # of unsound episodes


def check(config: CheckConfig, say: ReportProgress = silent) -> dict[str, Any]:
    """What each parameter changes, how well it can be found, facts of the recordings; JSON.

    Raises InputError for what cannot be used.
    """
    config.check()
    task = load_task(config.task)
    space = task.parameters
    image_size = needed_image_size("posterior")
    facts: dict[str, Any] = {"task": task.name, "seed": config.seed}
    if config.real:
        dataset = open_recordings(config.real, task, config, image_size)
        num_replayed = how_many(dataset, config.episodes)
        recorded = look_through(dataset, say)
        facts["recordings"] = dataset.facts(len(recorded))
        facts["warnings"] = warnings(task, facts["recordings"], recorded, num_replayed)
        # Supersampled as in tuning: a real camera averages over its pixels.
        simulator = task.simulator(image_size=image_size, step_s=dataset.step_s, supersampling=2)
        steps = min(len(actions) for actions in recorded[:num_replayed])
        actions = np.stack([actions[:steps] for actions in recorded[:num_replayed]])
    else:
        simulator = task.simulator(image_size=image_size)
        num, rng = config.episodes or _EPISODES, np.random.default_rng(config.seed)
        worlds = np.tile(space.nominal, (num, 1))
        act = simulator.explore(num, task.episode_steps, rng)
        actions = simulator.play(worlds, act, task.episode_steps, rng).actions
        facts["actions"] = "scripted" if task.script else "random"
    observation = ObservationModel.of_reality() if config.real else ObservationModel.of_simulator()
    information = analyze(simulator, task.camera, actions, config.seed, observation)
    facts |= {"episodes": len(actions), "steps": actions.shape[1], "step_s": simulator.step_s}
    return facts | conclude(space, information)


def look_through(dataset: Dataset, say: ReportProgress) -> list[np.ndarray]:
    """Actions (T, A) of all episodes, each of whose frames was looked at and none kept.

    Raises InputError, after the last episode, where one is unsound; which others are is said too.
    """
    actions, faults = [], {}
    for episode, name in enumerate(dataset.episodes):
        say("reading the recordings", episode / len(dataset.episodes))
        try:
            actions.append(dataset.skim(episode))
        except InputError as error:
            faults[name] = str(error)
    if faults:
        first, *others = faults
        more = ", ".join(others[:_MOST_NAMED]) + ", ..." * (len(others) > _MOST_NAMED)
        also = f"; {len(others)} more of {dataset.num_episodes} are unsound: {more}"
        raise InputError(faults[first] + also * bool(others))
    return actions
