"""Numbers that were measured beside each frame, and the names by which they are asked for."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings.source import Reading, short

NO_READINGS: Mapping[str, Sequence[str]] = {}


def readings_of(key: str, names: Sequence[str], num: int) -> list[Reading]:
    """The `num` numbers that are stored together as `key`.

    `names` are taken where each number has one; one that two numbers have is no name.
    """
    if len(names) != num:
        names = [""] * num
    return [
        Reading(key, index, name if names.count(name) == 1 else "")
        for index, name in enumerate(names)
    ]


def choose_readings(
    where: Path, known: Sequence[Reading], asked: Mapping[str, Sequence[str]]
) -> dict[str, list[Reading]]:
    """{sensor: its readings}, for {sensor: names of them}; see `docs/recordings.md`.

    A name is a full one or a place ("observation.state[3]"), that of a number alone where no other
    has it, or that of all numbers that are stored together.
    Raises InputError where there is no such one, or more than one.
    """
    return {sensor: _chosen(where, known, sensor, names) for sensor, names in asked.items()}


def gather(
    readings: Sequence[Reading], num_rows: int, read: Callable[[str], np.ndarray]
) -> np.ndarray:
    """(T, D) of T rows; `read` gives all numbers (T, ...) that are stored together as a key."""
    stored = {key: read(key) for key in {reading.key for reading in readings}}
    columns = [stored[reading.key][:, reading.index] for reading in readings]
    return np.reshape(columns, (len(readings), num_rows)).T


def _chosen(
    where: Path, known: Sequence[Reading], sensor: str, names: Sequence[str]
) -> list[Reading]:
    chosen = [reading for name in names for reading in _called(where, known, name)]
    if not chosen:
        raise InputError(f"{where}: expected a reading at least for {sensor}, got none")
    doubled = next((r for i, r in enumerate(chosen) if r in chosen[:i]), None)
    if doubled:
        raise InputError(f"{where}: {sensor} has {doubled.full_name} twice; name it once")
    return chosen


def _called(where: Path, known: Sequence[Reading], name: str) -> list[Reading]:
    if together := [reading for reading in known if reading.key == name]:
        return together
    for call in _CALLS:
        found = [reading for reading in known if name and call(reading) == name]
        if len(found) > 1:
            full = [reading.full_name for reading in found]
            names = full if len(set(full)) == len(full) else [r.place for r in found]
            raise InputError(f"{where}: {name!r} can be each of {short(names)}; name one of them")
        if found:
            return found
    if not known:
        raise InputError(f"{where}: no reading {name!r}; the recordings have no readings")
    calls = [call(reading) for call in _CALLS for reading in known if call(reading)]
    close = difflib.get_close_matches(name, calls, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    # As short as they may be asked for, since there may be many.
    there = [r.name if calls.count(r.name) == 1 else r.full_name for r in known]
    raise InputError(f"{where}: no reading {name!r}; {hint}there are: {short(there)}")


_CALLS: tuple[Callable[[Reading], str], ...] = (
    lambda reading: reading.full_name,
    lambda reading: reading.place,
    lambda reading: reading.name,
)
