"""`environment = ...` in a tuning file: a gymnasium environment instead of a model."""

from functools import partial
from typing import Any

from simtune.errors import InputError
from simtune.parameters import Parameter, ParameterSpace
from simtune.tasks.environment_task import EnvironmentTask
from simtune.tasks.tuning_file.toml_table import TomlTable, usual_name
from simtune.tasks.tuning_file.user_code import is_in_file, load_user_code

_KEYS = ("environment", "name", "description", "control_timestep_s", "episode_steps", "parameters")
_PARAMETER_KEYS = ("name", "nominal", "low", "high", "scale", "unit", "shows_in")


def read_environment_task(file: TomlTable) -> EnvironmentTask:
    """The task that a file declares. Raises InputError "FILE:LINE: ..."."""
    file.allow(*_KEYS)
    path, named = file.file, file.text("environment")
    make, source = partial(_registered, named), ""
    with file.at("environment"):
        if is_in_file(named):  # FILE.py:NAME is called, anything else is an id of gymnasium's
            make, source = load_user_code(path.parent, named)
    entries = file.tables("parameters")
    if not entries:
        raise file.error("nothing to tune: declare parameters, each after a line [[parameters]]")
    return EnvironmentTask(
        name=file.text("name", usual_name(path)),
        description=file.text("description", f"{named}, of {path.name}"),
        declared=file.content() + source,
        make=make,
        parameters=ParameterSpace([_read(entry) for entry in entries], where=path.name),
        step_s=file.number("control_timestep_s", above=0),
        episode_steps=file.whole("episode_steps", 200),
    )


def _read(entry: TomlTable) -> Parameter:
    entry.allow(*_PARAMETER_KEYS)
    low = entry.number("low")
    with entry.at():
        return Parameter(
            name=entry.text("name"),
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
        raise InputError(
            f"gymnasium does not know {named} ({error}); expected an id of its, or FILE.py:NAME"
        ) from None
