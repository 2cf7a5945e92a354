"""FILE.py:NAME in a tuning file: the user's code."""

import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from simtune.errors import InputError, blame


def is_in_file(named: str) -> bool:
    return re.fullmatch(r".+\.py:\w+", named) is not None


def load_user_code(folder: Path, named: str) -> tuple[Callable[..., Any], str]:
    """NAME in FILE.py, which lies beside the tuning file in `folder`; and the file's text.

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
    return found, path.read_text(encoding="utf-8")
