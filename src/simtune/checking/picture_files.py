"""Where pictures of a check are saved."""

import os
import tempfile
from pathlib import Path

from simtune.errors import InputError


def picture_file(asked: Path | None, which: str) -> Path:
    """The file that was asked for, else a new temporary one, with `which` at its name's end.

    Raises InputError if there is a file where a picture was asked for.
    """
    if asked:
        path = asked.with_stem(asked.stem + which)
        if path.exists():
            raise InputError(f"--pictures {asked}: {path} exists already; name a new file")
        return path
    handle, name = tempfile.mkstemp(prefix="simtune-check-", suffix=f"{which}.png")
    os.close(handle)
    return Path(name)
