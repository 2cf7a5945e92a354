"""Which episodes, camera and actions of recordings are used."""

from collections.abc import Sequence
from pathlib import Path

from simtune.errors import InputError, UnknownName
from simtune.recordings.controllers import named_in
from simtune.recordings.source import Source, short


def kept_episodes(where: Path, episodes: Sequence[str], leave_out: Sequence[str]) -> Sequence[int]:
    """Indices of the episodes that are not left out; `3` is short for `episode 3`.

    Raises InputError if there is no such episode, or none is left.
    """
    names = [name.removeprefix("episode ") for name in episodes]
    asked = [name.removeprefix("episode ") for name in leave_out]
    for name in asked:
        if name not in names:
            raise UnknownName("episode", name, f"{where}, as --leave-out has it", names)
    kept = [index for index, name in enumerate(names) if name not in asked]
    if not kept:
        raise InputError(f"{where}: no episode remains of {len(names)}: leave out fewer")
    return kept


def left_out(source: Source) -> list[str]:
    """Names of the episodes that are not used."""
    kept = set(source.kept)
    return [name for index, name in enumerate(source.episodes) if index not in kept]


def leave_out_option(names: Sequence[str]) -> str:
    """The option to type; it replaces an earlier one, so names are all episodes to leave out."""
    return f"--leave-out {','.join(name.removeprefix('episode ') for name in names)}"


def choose_camera(where: Path, cameras: Sequence[str], asked: str | None, full_name: str) -> str:
    """The camera `asked` for, such as "front"; its key may be longer, such as "{}_image".

    `full_name`: template of the longer key. Without `asked`, the only camera. Raises InputError if
    there is no such camera.
    """
    keys = cameras if asked is None else (asked, full_name.format(asked))
    if asked is None and len(cameras) > 1:
        raise InputError(
            f"{where}: has several cameras, choose one by --camera, or name them by "
            f"key in the tuning file's [[cameras]]: {short(cameras)}"
        )
    for key in keys:
        if key in cameras:
            return key
    raise InputError(f"{where}: no camera {asked!r}; there are: {short(cameras)}")


def choose_actions(
    source: Source, names: Sequence[str] | None, num_actions: int | None
) -> list[int]:
    """Columns of the actions `names` (None: all). Raises InputError if one does not exist.

    Also if one is not the only one of its name, or there are not `num_actions`, if given.
    """
    known = source.action_names
    names = names or ()
    for i, name in enumerate(names):
        if name not in known:
            raise UnknownName("action", name, str(source.path), known)
        if known.count(name) > 1:
            raise InputError(
                f"{source.path}: more than one action {name!r}; there are: {short(known)}"
            )
        if name in names[:i]:
            raise InputError(f"{source.path}: action {name!r} is asked for twice; name it once")
    chosen = [known.index(name) for name in names] if names else list(range(len(known)))
    if num_actions is not None and len(chosen) != num_actions:
        hint = _hint(source, num_actions, is_chosen=bool(names))
        there = f"{len(known)} ({short(known)})" if known else "none"
        has = f"--actions names {len(chosen)} of {there}" if names else f"the recording has {there}"
        raise InputError(f"{source.path}: the task takes {num_actions} actions, {has}; {hint}")
    return chosen


def _hint(source: Source, num_actions: int, *, is_chosen: bool) -> str:
    """What to do where a recording has another number of actions than the task."""
    if not source.action_names:
        return "a CSV beside each video has a column of each"
    if not is_chosen and (controller := named_in(source.path)):
        return controller
    if is_chosen or len(source.action_names) > num_actions:
        return (
            "name the task's, in its order, by --actions NAME,NAME,...; in a CSV, columns that "
            "were measured are called measured.NAME"
        )
    return "is it of another robot?"
