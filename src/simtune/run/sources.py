"""sources/: copies of the files that a run's task was read from, which make the run self-contained.

"sources" in config.json is the root: the folder to which the copies' paths are relative.
"""

import filecmp
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simtune.run.versions import changed_readers

SOURCES = "sources"


def keep_sources(run: Path, files: Sequence[Path]) -> str | None:
    """Copy files into RUN/sources, in the same layout; returns the root, None without files.

    `files`: absolute paths. The root is one folder above their common folder, whose name is kept,
    since it may be the task's name. Raises OSError if a file cannot be copied.
    """
    shutil.rmtree(run / SOURCES, ignore_errors=True)  # left by a run that was killed at its start
    if not files:
        return None
    root = Path(os.path.commonpath([file.parent for file in files])).parent
    for file in files:
        copy = run / SOURCES / file.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    return str(root)


def source_of(run: Path, stored: Mapping[str, Any], file: str) -> str:
    """The run's copy of a file that an option names, else the file itself.

    `stored`: content of config.json.
    """
    root = stored.get("sources")
    if root is None or not Path(file).is_relative_to(root):
        return file
    copy = run / SOURCES / Path(file).relative_to(root)
    return str(copy) if copy.is_file() else file


def named_sources(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Options that name the files of the run's copies; a resumed run may use moved files."""
    config = stored["config"] if stored.get("sources") else {}
    return {key: config[key] for key in ("task", "real_parameters") if key in config}


def changed_sources(run: Path, stored: Mapping[str, Any], task: str) -> list[str]:
    """Files of a tuning file `task`, which may have moved, that differ from the run's copies."""
    kept = Path(source_of(run, stored, str(stored["config"].get("task"))))
    if not kept.is_relative_to(run / SOURCES) or not Path(task).is_file():  # a built-in task
        return []
    changed = []
    for copy in sorted(path for path in (run / SOURCES).rglob("*") if path.is_file()):
        now = os.path.normpath(Path(task).parent / os.path.relpath(copy, kept.parent))
        if copy == kept:
            now = task
        if "__pycache__" not in copy.parts and not _is_same(copy, now):
            changed.append(now)
    return changed


def other_readers(run: Path, stored: Mapping[str, Any]) -> str:
    """Versions by which a run's task has another content, without a change in its files.

    Such as "mujoco 3.3.0 → 3.4.0"; empty if there are none, or if the run keeps no copies of its
    files, which may have changed as well.
    """
    task = str(stored["config"].get("task"))
    is_sure = source_of(run, stored, task) != task or not task.endswith(".toml")  # built-in
    return changed_readers(stored) if is_sure else ""


def _is_same(copy: Path, now: str) -> bool:
    try:
        return filecmp.cmp(copy, now, shallow=False)
    except OSError:  # the file is gone
        return False
