"""Colours that a user knows, such as a grey card's; a camera's gains are estimated from them."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from simtune.errors import InputError, UnknownName
from simtune.names import searches_where
from simtune.parameters import Parameter, ParameterSpace
from simtune.tasks.task import Task
from simtune.validate import is_number

_CHANNELS = ("r", "g", "b")


def with_known_colours(task: Task, asked: str | None) -> Task:
    """The task with the known colours of `--known-colour`: NAME or NAME=R,G,B, separated by ";".

    A colour without numbers has the model's value. Raises InputError for anything else, and if
    nothing is left to tune.
    """
    known = dict(task.known_colours)
    for entry in filter(None, (part.strip() for part in (asked or "").split(";"))):
        name, _, rgb = entry.partition("=")
        known |= known_colour(task.parameters, name.strip(), _rgb(entry, rgb) if rgb else None)
    if asked and len(known) == len(task.parameters):
        raise InputError(f"--known-colour {asked}: nothing to tune: all parameters are known")
    return replace(task, known_colours=known)


def check_known_is_used(known: Iterable[str], search: str) -> None:
    """Raises InputError if parameters are `known` by a tuning file, and `search` ignores it.

    `known`: their names. By the option it is refused before (`config.check_known_colour`).
    """
    if colours := list(dict.fromkeys(name[:-2] for name in known)):
        those = searches_where("takes_known_colours")
        raise InputError(
            f"known = true, which the tuning file says of {', '.join(colours)}, goes with {those}, "
            f"got {search}: take it out of the file for this search"
        )


def known_colour(
    space: ParameterSpace, name: str, rgb: tuple[float, ...] | None
) -> Mapping[str, float]:
    """{parameter: value} of the colour `name`; `rgb` None: the nominal one. Raises InputError."""
    names = [f"{name}_{channel}" for channel in _CHANNELS]
    there = list(dict.fromkeys(p.name[:-2] for p in space if _is_channel(p)))
    if name not in there:
        raise UnknownName("colour", name, "the parameters", there)
    values = [space[n].nominal for n in names] if rgb is None else rgb
    if not all(0 <= value <= 1 for value in values):
        raise InputError(f"a colour is three numbers from 0 to 1, got {list(values)}")
    return dict(zip(names, values, strict=True))


def known_values(task: object, space: ParameterSpace) -> np.ndarray:
    """(N,) known values of a task's parameters; NaN for unknown ones."""
    known = task.known_colours if isinstance(task, Task) else {}
    return np.array([known.get(name, np.nan) for name in space.names])


def _is_channel(parameter: Parameter) -> bool:
    return parameter.is_colour and parameter.name.endswith(tuple(f"_{c}" for c in _CHANNELS))


def _rgb(entry: str, rgb: str) -> tuple[float, ...]:
    """The numbers `rgb` of an entry NAME=R,G,B. Raises InputError."""
    try:
        values = tuple(float(number) for number in rgb.split(","))
    except ValueError:
        values = ()
    if len(values) != len(_CHANNELS) or not all(map(is_number, values)):
        raise InputError(f"--known-colour {entry}: expected NAME, or NAME=R,G,B from 0 to 1 each")
    return values
