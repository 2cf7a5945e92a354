"""`simtune example`: copies one of examples/, which the wheel includes."""

import shutil
from importlib.resources import as_file, files
from pathlib import Path

from simtune.errors import InputError, UnknownName

_SHARED = "unpack_wheel.py"  # beside the examples: some use it to unpack a robot's model
_MADE = shutil.ignore_patterns("model", "__pycache__", ".*")  # what running them leaves behind


def copy_example(name: str, folder: Path) -> Path:
    """FOLDER/NAME, as the docs' commands call it. Raises InputError if it already exists."""
    with as_file(files("simtune") / "examples") as examples:
        known = sorted(path.parent.name for path in examples.glob("*/tune.toml"))
        if name not in known:
            raise UnknownName("example", name, "simtune", known)
        out = folder / name
        if out.exists():
            raise InputError(f"{out} is there already: give another --out")
        try:
            shutil.copytree(examples / name, out, ignore=_MADE)
            shutil.copy(examples / _SHARED, folder / _SHARED)
        except OSError as error:
            raise InputError(f"cannot write {out}: {error.strerror}") from None
    return out
