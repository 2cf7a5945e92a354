"""FILE.py:NAME in a tuning file: the user's code."""

import hashlib
import importlib.util
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from simtune.errors import InputError, blame
from simtune.tasks.tuning_file.named_files import named_files


def is_in_file(named: str) -> bool:
    return re.fullmatch(r".+\.py:\w+", named) is not None


def load_user_code(folder: Path, named: str) -> tuple[Callable[..., Any], str]:
    """NAME in FILE.py, which lies beside the tuning file in `folder`; and the code's content.

    Raises InputError if it does not exist, or the file cannot be run.
    """
    if not is_in_file(named):
        raise InputError(f"expected FILE.py:NAME, a function in a file beside it, got {named}")
    file, _, name = named.rpartition(":")
    path = folder / file
    module_name = f"simtune_user_{path.stem}"  # differs from all other modules
    module_spec = importlib.util.spec_from_file_location(module_name, path)
    if not path.is_file() or module_spec is None or module_spec.loader is None:
        raise InputError(f"there is no file {path}")
    module = importlib.util.module_from_spec(module_spec)
    sys.modules[module_name] = module  # dataclasses, for one, look it up there
    sys.path.insert(0, str(path.parent))  # as if the file were run as a script
    try:
        with blame(f"{path} cannot be run"):
            module_spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    if not callable(found := getattr(module, name, None)):
        raise InputError(f"{path} has no {name} to call")
    return found, _content(path)


def _content(path: Path) -> str:
    """A file's text, and names and digests of what it imports or names, such as a model.

    They are the same in a run's copies, whose folders lie elsewhere.
    """
    first, *others = named_files(Path(os.path.abspath(path)))
    digests = []
    for other in others:
        is_within = other.is_relative_to(first.parent)
        name = other.relative_to(first.parent).as_posix() if is_within else other.name
        with other.open("rb") as file:
            digests.append(f"{name} {hashlib.file_digest(file, 'sha256').hexdigest()}\n")
    return path.read_text(encoding="utf-8") + "".join(sorted(digests))
