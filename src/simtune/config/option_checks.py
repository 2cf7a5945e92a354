"""Checks of options that several commands have."""

import re

from simtune.errors import InputError
from simtune.names import search_traits, searches_where


def at_least(config: object, smallest: int, *names: str) -> None:
    """Raises InputError if one of these fields is less than `smallest`; None is accepted."""
    for name in names:
        value = getattr(config, name)
        if value is not None and value < smallest:
            bound = f"be at least {smallest}" if smallest else "not be negative"
            raise InputError(f"{flag(name)} must {bound}, got {value}")


def usual_without(config: object, what: str, *names: str) -> None:
    """Raises InputError if one of these fields is not at its default: it goes with `what`."""
    for name in names:
        if getattr(config, name) != getattr(type(config), name):
            raise InputError(f"{flag(name)} goes with {what}")


def check_known_colour(asked: str | None, search: str) -> None:
    """Raises InputError if a known colour is `asked` for, and the search does not look for it.

    `search`: its name, or what is done in its place.
    """
    if asked is not None and not search_traits(search).takes_known_colours:
        known_by = searches_where("takes_known_colours")
        raise InputError(f"--known-colour goes with {known_by}, got {search}")


def check_seed(seed: int) -> None:
    """Raises InputError for a seed that random number generators do not accept."""
    if not 0 <= seed < 2**63:
        bound = "not be negative" if seed < 0 else "be below 2^63"
        raise InputError(f"--seed must {bound}, got {seed}")


def check_device(name: str) -> None:
    """Raises InputError for a name that no device has. Whether it is here is not looked at."""
    if not re.fullmatch(r"auto|cpu|cuda(:\d+)?", name):
        raise InputError(f"--device must be auto, cpu, cuda or cuda:N, got {name}")


def flag(name: str) -> str:
    """A field's name as a command-line option."""
    return f"--{name.replace('_', '-')}"
