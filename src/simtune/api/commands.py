"""`simtune check`, `tune` and `train` as functions.

Each takes the options of its command (docs/commands), with underscores: `--budget-minutes 3` is
`budget_minutes=3`. Unusable input raises a ValueError with a message of one line; a failure during
the run raises a RuntimeError. Nothing is printed without `progress`.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, replace
from os import PathLike, fspath
from os.path import expanduser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, cast

import numpy as np

from simtune.algorithm import train as carry_out_training
from simtune.api.arrays import EPISODES, RealLike, Record, film_once, write_arrays
from simtune.api.declared import declare
from simtune.api.result import CheckResult, Result
from simtune.api.spelling import in_python
from simtune.checking import carry_out as carry_out_check
from simtune.config import CheckConfig, TrainConfig, TuneConfig, check_types
from simtune.errors import InputError, UnknownName
from simtune.experiment.outcome import asked
from simtune.progress import ProgressBar, ReportProgress, silent
from simtune.report.read_run import read_finished
from simtune.run.config import FILMED, check_asked, stored_config
from simtune.tasks import IN_PYTHON, AnyTask, load_any_task, with_model
from simtune.tuning_run import tune as carry_out_tuning

TaskLike = str | PathLike[str] | Mapping[str, Any] | AnyTask
_Config = TypeVar("_Config", CheckConfig, TuneConfig, TrainConfig)
_RunConfig = TypeVar("_RunConfig", TuneConfig, TrainConfig)
_FILMED = 5  # episodes filmed if no number is given
_PATHS = ("out", "pictures", "camera_pose", "real_parameters", "robot")


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
) -> CheckResult:
    """Check what each parameter changes, how well it can be known, and that recordings are sound.

    `real`: recordings, a path or a list of dicts of arrays (docs/recordings.md). Other options:
    docs/commands/check.md. The result is a dict, whose repr is the command's table.
    """
    with in_python(), _progress(progress) as report, TemporaryDirectory() as folder:
        task, filmed = with_model(_known(task)), Path(folder) / FILMED
        place = real if real is None or isinstance(real, str | PathLike) else filmed
        config = _config(CheckConfig, task, options | {"real": place})
        if place is filmed:
            config = replace(config, real=_recordings(real, filmed, config.episodes))
        return CheckResult(*carry_out_check(config, report))


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
        config = _config_of_run(TuneConfig, task, real, options)
        with _progress(progress, 60 * budget_minutes) as report:
            carry_out_tuning(config, report, task=task)
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
    preset="paper". Other options: docs/commands/train.md. If `real` is "pseudo", `Result.content`
    has the policy's `return`, and what it reached of the task's goals, such as `success`.
    Without a search (dr, untuned), a function `real` films one episode, for the length of a step.
    """
    options |= {"out": out, "method": method, "seed": seed, "policy_steps": policy_steps}
    with in_python(), _progress(progress) as report:
        task = with_model(_known(task))
        carry_out_training(_config_of_run(TrainConfig, task, real, options), report)
    return load(out)


def load(run: str | PathLike[str]) -> Result:
    """The result of a finished run of `tune` or `train`. Raises ValueError if it is not one."""
    return Result(read_finished(Path(expanduser(run))))


def _config_of_run(
    kind: type[_RunConfig], task: AnyTask, real: RealLike, options: dict[str, Any]
) -> _RunConfig:
    """The config of a command; `real` is filmed or written once nothing else can be wrong."""
    if real is None:
        raise InputError("real is None; expected 'pseudo', a path, arrays, or a function")
    if not isinstance(options["out"], str | PathLike):
        raise InputError(f"out is a {type(options['out']).__name__}; expected a folder's path")
    out = Path(expanduser(options["out"]))
    folder = out / FILMED
    real = expanduser(real) if isinstance(real, str | PathLike) else real
    place = real if isinstance(real, str) else folder
    config = _config(kind, task, options | {"real": place})
    check_asked(out, asked(config, task))
    if callable(real) and stored_config(out) and not (folder / EPISODES).exists():
        raise InputError(f"{out} holds a run that was not filmed by a function; give another out")
    num = options.get("real_episodes")
    if not config.has_search:
        num = 1  # for the length of a step
    return replace(config, real=_recordings(real, folder, num))


def _recordings(real: Any, folder: Path, num: int | None) -> Any:
    """Path of recordings; arrays, or `num` filmed episodes, are written into `folder` first."""
    if real is None or isinstance(real, str | PathLike):
        return real
    if callable(real):
        return film_once(cast(Record, real), num or _FILMED, folder)
    return write_arrays(real, folder)


def _config(kind: type[_Config], task: AnyTask, options: dict[str, Any]) -> _Config:
    """The config of a command from its options. Raises InputError."""
    known = [field.name for field in fields(kind)]
    for name in options:
        if name not in known:
            command = kind.__name__.removesuffix("Config").lower()
            raise UnknownName("option", name, f"simtune.{command}", known)
    paths = (*_PATHS, *["real"] * (kind is CheckConfig))
    given: dict[str, Any] = {"task": task.source}
    for name, value in options.items():
        given[name] = fspath(value) if isinstance(value, PathLike) else value
        if isinstance(value, np.generic):
            given[name] = value.item()
    check_types(kind, given)
    there = [name for name in paths if given.get(name) is not None]
    given |= {name: Path(expanduser(given[name])) for name in there}
    config = kind(**given)
    config.check()
    return config


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
