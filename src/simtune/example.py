"""`simtune example`: one of examples/, which the wheel brings along, as files of one's own."""

import shutil
from importlib.resources import as_file, files
from pathlib import Path

from simtune.errors import InputError, UnknownName

_SHARED = "unpack_wheel.py"  # beside the examples: some unpack a robot's model with it
_MADE = shutil.ignore_patterns("model", "__pycache__", ".*")  # what trying them leaves behind


def copy_example(name: str, folder: Path) -> Path:
    """FOLDER/NAME, as the docs' commands call it. Raises InputError where it is there already."""
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
