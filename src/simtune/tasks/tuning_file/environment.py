"""`environment = ...` in a tuning file: a gymnasium environment instead of a model."""

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any

from simtune.errors import InputError
from simtune.parameters import Parameter, ParameterSpace
from simtune.tasks.environment_task import EnvironmentTask
from simtune.tasks.task import MOST_STEPS
from simtune.tasks.tuning_file.parameters import parameter_name
from simtune.tasks.tuning_file.user_code import is_in_file, load_user_code
from simtune.toml_reading import TomlTable, usual_name

_KEYS = ("environment", "name", "description", "control_timestep_s", "episode_steps", "parameters")
_PARAMETER_KEYS = ("name", "nominal", "low", "high", "scale", "unit", "shows_in")


def read_environment_task(file: TomlTable) -> EnvironmentTask:
    """The task with an environment that a file declares. Raises InputError "FILE:LINE: ..."."""
    file.allow(*_KEYS)
    path = file.file
    with file.at("environment"):
        named, make, source = _environment(file)
    entries = file.tables("parameters")
    if not entries:
        raise file.error("nothing to tune: declare parameters, each after a line [[parameters]]")
    return EnvironmentTask(
        name=file.text("name", usual_name(path)),
        description=file.text("description", f"{named}, of {path.name}"),
        declared=file.content(without="environment") + named + source,
        make=make,
        parameters=ParameterSpace([_read(entry) for entry in entries], where=path.name),
        step_s=file.number("control_timestep_s", above=0),
        episode_steps=file.whole("episode_steps", 200, most=MOST_STEPS),
    )


def _environment(file: TomlTable) -> tuple[str, Callable[[], Any], str]:
    """The environment's name, a function that makes it, and its source text, "" if unknown."""
    if isinstance(given := file.value("environment"), str):
        named = file.text("environment")
        if is_in_file(named):  # FILE.py:NAME; anything else is an id of gymnasium
            return named, *load_user_code(file.file.parent, named)
        return named, partial(_registered, named), ""
    is_made = hasattr(given, "reset") and not isinstance(given, type)
    if not is_made and not callable(given):
        raise InputError(
            f"expected a gymnasium.Env, or a class or function that makes one, got {given!r:.60}"
        )
    kind = type(given) if is_made else given
    named = f"{getattr(kind, '__module__', '')}.{getattr(kind, '__qualname__', '')}"
    try:
        source = inspect.getsource(kind)
    except (OSError, TypeError):  # defined at a prompt, or a partial
        source = ""
    return named, (lambda: given) if is_made else given, source


def _read(entry: TomlTable) -> Parameter:
    entry.allow(*_PARAMETER_KEYS)
    low = entry.number("low")
    with entry.at():
        return Parameter(
            name=parameter_name(entry),
            field=f"environment.{entry.choice('shows_in', ('picture', 'motion'), 'motion')}",
            nominal=entry.number("nominal"),
            low=low,
            high=entry.number("high"),
            scale=entry.choice("scale", ("log", "linear"), "log" if low > 0 else "linear"),
            unit=entry.text("unit", "1"),
        )


def _registered(named: str) -> Any:
    try:
        import gymnasium
    except ModuleNotFoundError:
        raise InputError(f"{named} needs gymnasium: pip install gymnasium") from None
    try:
        return gymnasium.make(named, render_mode="rgb_array", disable_env_checker=True)
    except (gymnasium.error.Error, ImportError) as error:
        is_missing = isinstance(error, ModuleNotFoundError)
        if is_missing and error.name:  # else gymnasium's own, of an id with a module
            raise InputError(
                f"{named} needs the Python package {error.name}, which is not installed: pip "
                "install it, or the extra that has it, such as gymnasium[mujoco]"
            ) from None
        of_code = gymnasium.error.DependencyNotInstalled, ImportError
        if isinstance(error, of_code) and not is_missing:
            raise InputError(f"{named} cannot be made: {error}") from None
        raise InputError(
            f"gymnasium does not know {named} ({error}); expected an id of its, or FILE.py:NAME"
        ) from None
