"""config.json: the configuration of a run, and checks that a command has the same one."""

import os
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from simtune.columns import cut
from simtune.config import TrainConfig, TuneConfig
from simtune.config.option_checks import flag
from simtune.errors import InputError
from simtune.run.files import read_json
from simtune.run.sources import SOURCES, changed_sources
from simtune.run.versions import changed_readers
from simtune.validate import is_number

# Options that may change when a run is resumed, such as its place and duration
_MAY_DIFFER = ("out", "budget_minutes", "device", "move", "task_name", "json")
# Options whose value may change if the content stays the same: {option: key with a content hash}
_CONTENT = {
    "task": "task_content",
    "real": "recordings.dataset_hash",
    "real_parameters": "truth",
}
# "stopped" in result.json of `tune`, if the budget ended the run
TIME_IS_OVER = "the time is over, or too short for another round"
FILMED = "filmed"  # folder of a robot's recordings, which cannot be repeated


def stored_config(path: Path) -> dict[str, Any] | None:
    """config.json of the run at `path`; None if a new run can start there. Raises InputError."""
    if path.exists() and not path.is_dir():
        raise InputError(f"{path} is a file: give --out a folder")
    if not path.exists() or not any(p for p in path.iterdir() if not _is_leftover(p)):
        return None
    if not (path / "config.json").is_file():
        raise InputError(f"{path} is not empty and no run: give --out a new or an empty folder")
    try:
        stored = read_json(path / "config.json")
        if not isinstance(stored["config"], dict):
            raise TypeError
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}/config.json is damaged: nothing can go on there; a new run needs a new folder"
        ) from None
    return stored


def check_names_task(path: Path, config: Mapping[str, Any]) -> None:
    """Raises InputError if the stored options of the run at `path` name no task."""
    if "task" not in config:
        raise InputError(f"{path / 'config.json'} is damaged: its config has no task")


def _is_leftover(path: Path) -> bool:
    """Whether a run that ended before its first config.json left this: e.g. a temporary file."""
    is_temporary = path.name.startswith(".") and path.name.endswith(".tmp")
    return is_temporary or path.name in (FILMED, SOURCES)


def check_asked(path: Path, asked: dict[str, Any]) -> None:
    """Like `check_same`, for the keys in `asked` only; works before recordings are read."""
    if (stored := stored_config(path)) is not None:
        known = {key: value for key, value in stored["config"].items() if key in asked}
        check_same(path, stored | {"config": known}, asked)


def option_defaults(kind: type[TrainConfig] | type[TuneConfig]) -> dict[str, Any]:
    """{option: default} of a command, for runs of versions that did not have all options."""
    return {option.name: option.default for option in fields(kind) if option.default is not MISSING}


def check_same(path: Path, stored: dict[str, Any], config: dict[str, Any]) -> None:
    """Raise InputError, naming the differences, if a run's config.json has another `config`.

    An option that the run's version did not have counts as its default.
    """
    before, now = _flat(stored["config"]), _flat(config)
    is_training = "method" in now
    if ("method" in before) == is_training:
        defaults = option_defaults(TrainConfig if is_training else TuneConfig)
        before = {key: value for key, value in defaults.items() if key in now} | before
    differing = [
        key
        for key in sorted({*before, *now}, key=lambda key: (key.count("."), key))  # causes first
        if before.get(key) != now.get(key)
        and not _is_same_content(key, before, now)
        and not any(key == free or key.startswith(f"{free}.") for free in _MAY_DIFFER)
    ]
    if differing:
        contents = _other_contents(path, stored, now, differing)
        words = [_difference(key, before, now) for key in differing]
        words = [contents.get(k, word) for k, word in zip(differing, words, strict=True)]
        said = cut(list(dict.fromkeys(filter(None, words))), 3, "; ")
        raise InputError(
            f"{path} holds a run with {said}: "
            "give the same values to go on with it, or another --out to start anew"
        )


def _is_same_content(key: str, before: dict[str, Any], now: dict[str, Any]) -> bool:
    content = _CONTENT.get(key, "")
    return before.get(content) is not None and before.get(content) == now.get(content)


def _other_contents(
    path: Path, stored: dict[str, Any], now: dict[str, Any], differing: list[str]
) -> dict[str, str]:
    """{key: words} for keys with hashes: which files differ from those of the run.

    The words are empty for a key whose difference another key explains.
    """
    words = {
        "recordings.dataset_hash": f"other recordings than {now.get('real')}",
        "truth": "other values in --real-parameters",
    }
    if "recordings.dataset_hash" in differing:
        words["real"] = ""
    if tasks := {"task_content", "policy_content"}.intersection(differing):
        files = changed_sources(path, stored, str(now.get("task")))
        if "task" in differing and str(now["task"]) in files:
            is_moved = not os.path.exists(str(stored["config"].get("task")))
            if not (is_moved and all(map(os.path.exists, files))):
                files = []  # another task, not this one with changes
        said = "another content of the task, as this version of simtune or MuJoCo reads it"
        if readers := changed_readers(stored):
            said += f" ({readers})"
        if files:
            said = f"another content of {' and '.join(files)} (its own: {path / SOURCES})"
            words["task"] = ""  # explained by the changed files
        elif "task" in differing:
            said = ""
        words |= dict.fromkeys(tasks, said)
    return words


def _flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one mapping with dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _difference(key: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Both values of a key: those of an option as a user types them."""
    is_option = key in option_defaults(TrainConfig) | option_defaults(TuneConfig)
    show = _show_option if is_option else _show
    return f"{flag(key) if is_option else key} {show(before, key)}, now {show(now, key)}"


def _show(flat: Mapping[str, Any], key: str) -> str:
    return f"= {flat[key]!r}" if key in flat else "not set"


def _show_option(flat: Mapping[str, Any], key: str) -> str:
    value = flat.get(key)
    if value is None or isinstance(value, bool):
        return "given" if value else "not given"
    # config.json has the share, see `TuneConfig.relative_precision`
    return f"{100 * value:g}%" if key == "precision" and is_number(value) else str(value)
