"""Whether runs, and those that have begun, fit what the files that the grid names hold now."""

from collections.abc import Sequence
from pathlib import Path

from simtune.config import TrainConfig, TuneConfig
from simtune.experiment.finished import real_content, recordings_hash
from simtune.experiment.outcome import asked
from simtune.experiment.presets import choose_search
from simtune.names import search_traits
from simtune.parameters.values_file import read_parameters
from simtune.real.observed import observed
from simtune.run.config import check_asked, stored_config
from simtune.sweep.asked import AskedRun
from simtune.sweep.standing import Places
from simtune.tasks import (
    AnyTask,
    Task,
    check_known_is_used,
    check_reward,
    load_any_task,
    with_known_colours,
    with_model,
    with_one_square_camera,
)


def check_options(config: TuneConfig | TrainConfig, task: AnyTask) -> None:
    """Raises InputError for options that the task does not admit. Opens no recordings."""
    is_training = isinstance(config, TrainConfig)
    search = choose_search(config) if isinstance(config, TrainConfig) else config.search
    if is_training:
        check_reward(task)
    traits = search_traits(search)
    if isinstance(task, Task) and search and not traits.takes_known_colours:
        check_known_is_used(task.known_colours, search)
    if config.known_colour:
        with_known_colours(with_model(task), config.known_colour)
    if is_training or traits.needs_square_pictures:
        with_one_square_camera(task)
    observed(task, config.observed, is_simulated=False)
    if config.real == "pseudo":
        read_parameters(config.real_parameters, task.parameters)


def check_contents(runs: Sequence[AskedRun], folder: Path) -> None:
    """Raises InputError if a run that has begun was of another content of its task or real world.

    That is, of other recordings, or another truth of a pseudo-real world.
    """
    tasks, hashes = dict[str, AnyTask](), _Hashes()
    for run in runs:
        path, source = Places(folder, run.name).run, run.values["task"]
        if not (path / "config.json").is_file() or not (stored := stored_config(path)):
            continue
        config = run.config()
        task = tasks[source] = tasks.get(source) or load_any_task(source)
        check_asked(path, asked(config, task))
        check_asked(path, real_content(config, task, stored["config"], hashes.of))


class _Hashes:
    """Hashes of recordings, as runs store them; each is computed once, for all runs."""

    def __init__(self):
        self._known = dict[tuple[str | None, ...], str]()

    def of(self, config: TuneConfig | TrainConfig, task: AnyTask) -> str:
        """Raises InputError for what the run would refuse."""
        seen = observed(task, config.observed, is_simulated=False)
        which = (config.real, config.camera, *(c.footage.key for c in seen.cameras))
        if which not in self._known:
            self._known[which] = recordings_hash(config, task)
        return self._known[which]
