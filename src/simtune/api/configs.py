"""The config of a command from what Python code asks for; what it films is written first."""

from dataclasses import fields, replace
from os import PathLike, fspath
from os.path import expanduser
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from simtune.api.arrays import EPISODES, FilmEpisode, RealLike, film_once, write_arrays
from simtune.config import CheckConfig, RecordConfig, TrainConfig, TuneConfig, check_types
from simtune.errors import InputError, UnknownName
from simtune.experiment.outcome import asked
from simtune.run.config import FILMED, check_asked, stored_config
from simtune.tasks import AnyTask

_Config = TypeVar("_Config", CheckConfig, TuneConfig, TrainConfig, RecordConfig)
_RunConfig = TypeVar("_RunConfig", TuneConfig, TrainConfig)
_NUM_FILMED = 5  # episodes filmed if no number is given
_PATHS = ("out", "pictures", "camera_pose", "real_parameters", "robot", "parameters")


def config_of_check(
    task: AnyTask, real: RealLike | None, options: dict[str, Any], folder: Path
) -> CheckConfig:
    """The config of `check`; arrays, or what is filmed, are written into `folder`."""
    is_place = real is None or isinstance(real, str | PathLike)
    config = _config(CheckConfig, task, options | {"real": real if is_place else folder})
    return config if is_place else replace(config, real=_recordings(real, folder, config.episodes))


def config_of_record(task: AnyTask, options: dict[str, Any]) -> RecordConfig:
    """The config of `record`; its policy may be a run's folder."""
    policy = options["policy"]
    if isinstance(policy, str | PathLike):
        options = options | {"policy": expanduser(fspath(policy))}
    return _config(RecordConfig, task, options)


def config_of_run(
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
        return film_once(cast(FilmEpisode, real), num or _NUM_FILMED, folder)
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
