"""A command's result that shows itself as the command prints it."""

from collections.abc import Mapping, Sequence
from typing import Any


class Shown(dict[str, Any]):
    """A dict of JSON, as a command's `--json`; its repr is what the command prints without."""

    def __init__(self, content: Mapping[str, Any], lines: Sequence[str]):
        super().__init__(content)
        self._text = "\n".join(lines)

    def __repr__(self) -> str:
        return self._text
