"""Whether runs, and those that have begun, fit what the files that the grid names hold now."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simtune.config import NO_RECORDINGS, TrainConfig, TuneConfig
from simtune.experiment.outcome import asked
from simtune.parameters.values_file import read_parameters
from simtune.real.observed import observed, open_recordings
from simtune.real.truth import Truth
from simtune.run.config import check_asked, stored_config
from simtune.sweep.asked import AskedRun
from simtune.sweep.standing import Places
from simtune.tasks import (
    AnyTask,
    check_reward,
    load_any_task,
    with_known_colours,
    with_model,
    with_one_square_camera,
)


def check_options(config: TuneConfig | TrainConfig, task: AnyTask) -> None:
    """Raises InputError for options that the task does not admit. Opens no recordings."""
    is_training = isinstance(config, TrainConfig)
    if is_training:
        check_reward(task)
    if config.known_colour:
        with_known_colours(with_model(task), config.known_colour)
    if is_training or config.search != "posterior":
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
        check_asked(path, _real_content(config, task, stored["config"], hashes))


def _real_content(
    config: TuneConfig | TrainConfig, task: AnyTask, stored: Mapping[str, Any], hashes: "_Hashes"
) -> dict[str, Any]:
    """The part of `outcome.run_config` that `asked` leaves out, if a run's `stored` one has it.

    A training that needs no recordings has not read them.
    """
    if config.real == "pseudo" and stored.get("truth"):
        parameters = read_parameters(config.real_parameters, task.parameters)
        file = config.real_parameters and str(config.real_parameters)
        return {"truth": Truth(task.parameters, parameters).digest, "real_parameters": file}
    if config.real not in NO_RECORDINGS and stored.get("recordings"):
        return {"recordings": {"dataset_hash": hashes.of(config, task)}, "real": config.real}
    return {}


class _Hashes:
    """Hashes of recordings, as runs store them; each is computed once, for all runs."""

    def __init__(self):
        self._known = dict[tuple[str | None, ...], str]()

    def of(self, config: TuneConfig | TrainConfig, task: AnyTask) -> str:
        """Raises InputError for what the run would refuse."""
        seen = observed(task, config.observed, is_simulated=False)
        which = (config.real, config.camera, *(c.footage.key for c in seen.cameras))
        if which not in self._known:
            dataset = open_recordings(config.real, task, config, None, seen)
            self._known[which] = dataset.content_hash
        return self._known[which]
