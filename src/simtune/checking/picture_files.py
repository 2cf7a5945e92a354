"""Where pictures of a check are saved."""

import os
import tempfile
from pathlib import Path

from simtune.config.picture_files import check_replaceable


def picture_file(asked: Path | None, which: str) -> Path:
    """The file that was asked for, else a new temporary one, with `which` at its name's end.

    Raises InputError if there is a file that is no picture where one was asked for.
    """
    if asked:
        path = asked.with_stem(asked.stem + which)
        check_replaceable(path, asked)
        return path
    handle, name = tempfile.mkstemp(prefix="simtune-check-", suffix=f"{which}.png")
    os.close(handle)
    return Path(name)
