"""config.json: the configuration of a run, and whether a command has the same."""

import importlib.metadata
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import simtune
from simtune.columns import cut
from simtune.errors import InputError
from simtune.run.files import read_json
from simtune.run.sources import SOURCES, changed_sources

# What may change between a run and its resumption: where it lies and how long it goes on.
_MAY_DIFFER = ("out", "budget_minutes", "device", "move", "task_name", "json")
# What may be spelt in another way, or lie elsewhere, and which key tells by its content.
_CONTENT = {
    "task": "task_content",
    "real": "recordings.dataset_hash",
    "real_parameters": "truth",
}
# Of a run of `tune`, in result.json: it was not over by itself.
TIME_IS_OVER = "the time is over, or too short for another round"
FILMED = "filmed"  # the folder of what a robot did; it cannot be filmed again


def stored_config(path: Path) -> dict[str, Any] | None:
    """config.json of the run at `path`; None where a new run can start. Raises InputError."""
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


def _is_leftover(path: Path) -> bool:
    """Of a run that ended before its first config.json: a temporary file, or what it filmed."""
    is_temporary = path.name.startswith(".") and path.name.endswith(".tmp")
    return is_temporary or path.name in (FILMED, SOURCES)


def check_asked(path: Path, asked: dict[str, Any]) -> None:
    """`check_same` as far as it can be said before recordings are read: of what `asked` names."""
    if (stored := stored_config(path)) is not None:
        known = {key: value for key, value in stored["config"].items() if key in asked}
        check_same(path, stored | {"config": known}, asked)


def check_same(path: Path, stored: dict[str, Any], config: dict[str, Any]) -> None:
    """Raise InputError, naming what differs, where a run's config.json has another `config`."""
    before, now = _flat(stored["config"]), _flat(config)
    differing = [
        key
        for key in sorted({*before, *now}, key=lambda key: (key.count("."), key))  # causes first
        if before.get(key) != now.get(key)
        and not _is_same_content(key, before, now)
        and not any(key == free or key.startswith(f"{free}.") for free in _MAY_DIFFER)
    ]
    if differing:
        contents = _other_contents(path, stored, now, differing)
        words = [f"{k} {_show(before, k)}, now {_show(now, k)}" for k in differing]
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
    """Of the keys that hold hashes: which files differ from what the run was made with.

    Nothing of a key that another one explains.
    """
    words = {
        "recordings.dataset_hash": f"other recordings than {now.get('real')}",
        "truth": "other values in --real-parameters",
    }
    if "recordings.dataset_hash" in differing:
        words["real"] = ""
    if tasks := {"task_content", "policy_content"}.intersection(differing):
        files = changed_sources(path, stored, str(now.get("task")))
        said = "another content of the task, as this version of simtune or MuJoCo reads it"
        if files:
            said = f"another content of {' and '.join(files)} (its own: {path / SOURCES})"
            words["task"] = ""  # the same, elsewhere
        elif "task" in differing:
            said = ""
        words |= dict.fromkeys(tasks, said)
    return words


def _flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one, with dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _show(flat: Mapping[str, Any], key: str) -> str:
    return f"= {flat[key]!r}" if key in flat else "not set"


def versions() -> dict[str, str]:
    packages = ("mujoco", "mujoco_warp", "torch")
    return {
        "simtune": simtune.__version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in packages},
        "platform": platform.platform(),
    }
