"""What a command returns, and words for the lines that it prints."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

PrintLine = Callable[[str], None]


class CommandResult(NamedTuple):
    """The outcome of a command."""

    content: dict[str, Any]  # printed by --json
    failure: str = ""  # why the exit status is 1; empty if it is 0


def quoted(path: str | Path) -> str:
    """As a shell reads it."""
    return shlex.quote(str(path))
