"""The latch makes an emergency stop last until a person ends it."""

import os
from datetime import datetime
from pathlib import Path

from simtune.errors import InputError


class Latch:
    """A file beside the robot's file: while it exists, nothing moves. Only a person removes it."""

    def __init__(self, file: Path):
        self.file = file

    def check(self) -> None:
        """Raises InputError if the robot was stopped, or a stop could not be written down."""
        if self.file.exists():
            why = " ".join(self.file.read_text(encoding="utf-8").split())
            raise InputError(
                f"the robot was stopped ({why}): see to it, then remove {self.file} to go on"
            )
        if not os.access(self.file.parent, os.W_OK):
            raise InputError(f"{self.file.parent} must be writable: a stop is noted down there")

    def close(self, why: object) -> None:
        """Write down that the robot was stopped, and why; the first reason is kept."""
        if not self.file.exists():
            when = datetime.now().astimezone().isoformat(timespec="seconds")
            self.file.write_text(f"{when}: {why}\n", encoding="utf-8")
