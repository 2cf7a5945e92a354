"""A task declared by a dict with a tuning file's keys; it may hold objects instead of files."""

import json
import os
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.export.mjcf import write_spec
from simtune.tasks import IN_PYTHON, AnyTask, load_any_task, named_files, read_declared
from simtune.tasks.tuning_file.user_code import is_in_file

_NAMING_FILES = ("model", "environment", "background", "calibration", "reward", "success")


def declare(values: Mapping[str, Any]) -> AnyTask:
    """The task of a dict; `model` may be an MjSpec, `environment` an object or a factory.

    Except with such an environment, the task is written as files, which a run copies like any
    task's. Raises InputError "task['parameters'][0]: what is wrong".
    """
    plain = _plain(values)
    task = read_declared(plain)
    if task.source.startswith(IN_PYTHON):
        return task
    folder = Path(mkdtemp(dir=_folder().name), "task")
    return load_any_task(str(_write(plain, folder)))


@cache
def _folder() -> TemporaryDirectory:
    """A folder that exists until Python ends; a run copies what it needs when it starts."""
    return TemporaryDirectory(prefix="simtune-")


def _plain(value: Any) -> Any:
    """Convert values to TOML's types; other objects are kept."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return [_plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def _write(values: dict[str, Any], folder: Path) -> Path:
    """Write FOLDER/task.toml, and all files that it names beside it; returns its path."""
    folder.mkdir()
    file = folder / "task.toml"
    written = _with_files(values, folder)
    text = "".join(f"{_toml(k)} = {_toml(v)}\n" for k, v in written.items())
    file.write_text(text, encoding="utf-8")
    return file


def _with_files(value: Any, folder: Path, key: str = "") -> Any:
    """The same value, with files replaced by copies in `folder`, and specs by written models."""
    if isinstance(value, dict):
        return {k: _with_files(inner, folder, k) for k, inner in value.items()}
    if isinstance(value, list):
        return [_with_files(inner, folder) for inner in value]
    if isinstance(value, mujoco.MjSpec):
        write_spec(value, folder)
        return "model.xml"
    return _copied(value, folder) if key in _NAMING_FILES and isinstance(value, str) else value


def _copied(named: str, folder: Path) -> str:
    """Copy FILE or FILE.py:NAME into `folder`; returns the name relative to it."""
    file, colon, name = named.rpartition(":") if is_in_file(named) else (named, "", "")
    if not Path(file).is_file():  # for example, an id of a gymnasium environment
        return named
    path = Path(file).resolve()
    files = named_files(path)
    root = Path(os.path.commonpath([f.parent for f in files]))
    own = folder / str(sum(1 for _ in folder.iterdir()))  # a new subfolder avoids name clashes
    for source in files:
        copy = own / source.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, copy)
    return str((own / path.relative_to(root)).relative_to(folder)) + colon + name


def _toml(value: Any) -> str:
    """A value in TOML, on one line. Raises InputError for other types."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_toml(k)} = {_toml(v)}' for k, v in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", r"\u007f")  # DEL
    if isinstance(value, int | float):
        return repr(value)
    raise InputError(f"expected a text, a number, a list or a dict in the task, got {value!r:.60}")
