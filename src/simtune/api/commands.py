"""`simtune check`, `tune`, `train` and `record` as functions.

Each takes the options of its command (docs/commands), with underscores: `--budget-minutes 3` is
`budget_minutes=3`. Unusable input raises a ValueError with a message of one line; a failure during
the run raises a RuntimeError. Without `progress`, nothing is printed but warnings: these go to
Python's logging, which writes them to stderr unless it is set up otherwise.

They import within what takes seconds to load: to read a run, none of it is needed.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from os.path import expanduser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from simtune.api.arrays import RealLike
from simtune.api.configs import config_of_check, config_of_record, config_of_run
from simtune.api.declared import declare
from simtune.api.on_runs import Values, as_file
from simtune.api.result import Result
from simtune.api.shown import Shown
from simtune.api.spelling import in_python
from simtune.config import RecordConfig, TrainConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.finished import finished_result
from simtune.progress import ProgressBar, ReportProgress, silent
from simtune.run.config import FILMED
from simtune.run_data import read_finished
from simtune.tasks import IN_PYTHON, AnyTask, load_any_task, with_model
from simtune.threads import wait_passively

TaskLike = str | PathLike[str] | Mapping[str, Any] | AnyTask


def load_task(task: str | PathLike[str] | Mapping[str, Any]) -> AnyTask:
    """A task: a built-in one by name, or declared by a tuning file or a dict with its keys.

    In a dict, `model` may be a `mujoco.MjSpec`, and `environment` a gymnasium.Env, or a class or
    function that makes one. A task has a `name`, `parameters` (each with name, nominal, low, high,
    unit) and, unless it is of an environment, `load_model()`.
    Raises ValueError `FILE:LINE: what is wrong`; for a dict `task['parameters'][0]: ...`.
    """
    if not isinstance(task, str | PathLike | Mapping):
        raise InputError(
            f"the task is a {type(task).__name__}; expected a built-in task's name, a tuning "
            "file's path, or a dict with its keys"
        )
    return declare(task) if isinstance(task, Mapping) else load_any_task(expanduser(task))


def check(
    task: TaskLike,
    *,
    real: RealLike | None = None,
    progress: bool = False,
    **options: Any,
) -> Shown:
    """Check what each parameter changes, how well it can be known, and that recordings are sound.

    `real`: recordings, a path or a list of dicts of arrays (docs/recordings.md). Other options:
    docs/commands/check.md. The result is a dict, whose repr is the command's table.
    """
    wait_passively()
    from simtune.checking import carry_out

    with in_python(), _progress(progress) as report, TemporaryDirectory() as folder:
        config = config_of_check(with_model(_known(task)), real, options, Path(folder) / FILMED)
        return Shown(*carry_out(config, report))


def tune(
    task: TaskLike,
    *,
    out: str | PathLike[str],
    real: RealLike = "pseudo",
    real_episodes: int | None = None,
    budget_minutes: float = TuneConfig.budget_minutes,
    precision: str = TuneConfig.precision,
    seed: int = 0,
    progress: bool = False,
    **options: Any,
) -> Result:
    """Find the parameters of a real world from video, actions and joint readings.

    `real`: recordings, as a path or a list of dicts of arrays (docs/recordings.md), which are
    written into `out`; a function that films such a dict, called once with each episode's number;
    or "pseudo", a simulated world for trying. `out`: the run's folder; the same call resumes an
    interrupted run. `budget_minutes`: maximum wall time. `precision`: stop earlier once this is
    reached, such as "1%". Other options: docs/commands/tune.md.
    """
    options |= {"out": out, "real_episodes": real_episodes, "seed": seed}
    options |= {"budget_minutes": budget_minutes, "precision": precision}
    with in_python():
        task = _known(task)
        config = config_of_run(TuneConfig, task, real, options)
        with _progress(progress, 60 * budget_minutes) as report:
            if finished_result(config, task) is None:
                wait_passively()
                from simtune.tuning_run import tune as carry_out

                carry_out(config, report, task=task)
    return load(out)


def train(
    task: TaskLike,
    *,
    out: str | PathLike[str],
    real: RealLike = "pseudo",
    method: str = TrainConfig.method,
    policy_steps: int | None = None,
    seed: int = 0,
    progress: bool = False,
    **options: Any,
) -> Result:
    """Train a policy on pictures, in a simulator that is tuned meanwhile (Algorithm 1).

    Arguments as in `tune`. `method`: autotune, regression, dr, untuned or oracle. `policy_steps`:
    simulated steps that the policy learns from, by default the task's, or 500,000 with
    preset="paper". Other options: docs/commands/train.md. If `real` is "pseudo", `Result.score`
    has the policy's return, and what it reached of the task's goals.
    Without a search (dr, untuned), a function `real` films one episode, for the length of a step.
    """
    wait_passively()
    from simtune.algorithm import train as carry_out

    options |= {"out": out, "method": method, "seed": seed, "policy_steps": policy_steps}
    with in_python(), _progress(progress) as report:
        task = with_model(_known(task))
        carry_out(config_of_run(TrainConfig, task, real, options), report)
    return load(out)


def record(
    task: TaskLike,
    *,
    out: str | PathLike[str],
    episodes: int = RecordConfig.episodes,
    parameters: Values = None,
    policy: str | PathLike[str] = RecordConfig.policy,
    seed: int = 0,
    progress: bool = False,
    **options: Any,
) -> Path:
    """Film a simulated world as a LeRobotDataset, in the new folder `out`; returns the folder.

    `parameters` of the world: a JSON file or a dict, {name: value} or a result's `parameters`.
    `policy`: "random", "scripted", or the folder of a run of `train`. Other options:
    docs/commands/record.md.
    """
    wait_passively()
    from simtune.filming import record as carry_out

    options |= {"out": out, "episodes": episodes, "seed": seed, "policy": policy}
    with in_python(), _progress(progress) as report, as_file(parameters) as file:
        known = with_model(_known(task))
        config = config_of_record(known, options | {"parameters": file})
        return carry_out(config, report)


def load(run: str | PathLike[str]) -> Result:
    """The result of a finished run of `tune` or `train`. Raises ValueError if it is not one."""
    return Result(read_finished(Path(expanduser(run))))


def _known(task: TaskLike) -> AnyTask:
    """The task, which its source must find again when a run is resumed or exported."""
    if not isinstance(task, AnyTask):
        return load_task(task)
    if task.source.startswith(IN_PYTHON):
        return task
    if not task.source or load_any_task(task.source).content_hash != task.content_hash:
        raise InputError(
            f"the task {task.name!r} is not as {task.source or 'any file'} declares it: change the "
            "tuning file instead, and give its path, or what simtune.load_task makes of it"
        )
    return task


@contextmanager
def _progress(shown: bool, total_s: float = float("inf")) -> Iterator[ReportProgress]:
    if not shown:
        yield silent
        return
    with ProgressBar(total_s) as bar:
        yield bar
