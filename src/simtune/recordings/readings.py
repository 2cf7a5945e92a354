"""Numbers measured with each frame, and the names by which they are requested."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings.source import Reading, short

NO_READINGS: Mapping[str, Sequence[str]] = {}
NO_PERIODS: Mapping[str, np.ndarray] = {}


def readings_of(key: str, names: Sequence[str], num: int) -> list[Reading]:
    """The `num` readings stored together as `key`.

    `names` are used if there is one for each number; a name that two numbers have is dropped.
    """
    if len(names) != num:
        names = [""] * num
    return [
        Reading(key, index, name if names.count(name) == 1 else "")
        for index, name in enumerate(names)
    ]


def choose_readings(
    where: Path,
    known: Sequence[Reading],
    asked: Mapping[str, Sequence[str]],
    actions: Sequence[str] = (),
) -> dict[str, list[Reading]]:
    """{sensor: readings} for `asked`, {sensor: names}; see `docs/recordings.md`.

    A name is one of: a full name, a place ("observation.state[3]"), a reading's own name if no
    other reading has it, or a key, for all numbers stored together. `actions` are columns that
    are taken for actions. Raises InputError if no reading, or more than one, has the name.
    """
    if not known and (name := next((name for names in asked.values() for name in names), None)):
        raise InputError(f"{where}: no reading {name!r}; {_none_there(name, actions)}")
    return {sensor: _chosen(where, known, sensor, names) for sensor, names in asked.items()}


def _none_there(name: str, actions: Sequence[str]) -> str:
    """What to do if a table's columns are not called readings, such as the one meant by `name`."""
    own = name.rpartition(".")[2].lower()
    alike = [action for action in actions if own in action.lower()]
    return "the recordings have no readings: in a CSV, call their columns measured.NAME" + (
        f" (these look like it: {short(alike)})" if alike else ""
    )


def gather(
    readings: Sequence[Reading], num_rows: int, read: Callable[[str], np.ndarray]
) -> np.ndarray:
    """(T, D) readings of T rows; `read` returns all numbers (T, ...) stored as a key."""
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
    calls = [call(reading) for call in _CALLS for reading in known if call(reading)]
    close = difflib.get_close_matches(name, calls, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    # The shortest name of each that is unique, since there may be many.
    there = [r.name if calls.count(r.name) == 1 else r.full_name for r in known]
    raise InputError(f"{where}: no reading {name!r}; {hint}there are: {short(there)}")


_CALLS: tuple[Callable[[Reading], str], ...] = (
    lambda reading: reading.full_name,
    lambda reading: reading.place,
    lambda reading: reading.name,
)
