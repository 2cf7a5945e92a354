"""Where pictures of a check are saved."""

import os
import tempfile
from pathlib import Path


def picture_file(asked: Path | None, which: str) -> Path:
    """The file that was asked for, else a new temporary one, with `which` at its name's end."""
    if asked:
        return asked.with_stem(asked.stem + which)
    handle, name = tempfile.mkstemp(prefix="simtune-check-", suffix=f"{which}.png")
    os.close(handle)
    return Path(name)
