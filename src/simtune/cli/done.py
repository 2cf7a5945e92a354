"""What a command hands back, and words for its lines."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

Say = Callable[[str], None]  # prints a line


class Done(NamedTuple):
    """The outcome of a command."""

    result: dict[str, Any]  # printed by --json
    failure: str = ""


def quoted(path: str | Path) -> str:
    """As a shell reads it."""
    return shlex.quote(str(path))
