"""An emergency stop lasts until a person ends it."""

import os
from datetime import datetime
from pathlib import Path

from simtune.errors import InputError


class Latch:
    """A file beside the robot's: while it is there, nothing moves. Only a person removes it."""

    def __init__(self, file: Path):
        self.file = file

    def check(self) -> None:
        """Raises InputError where the robot has been stopped, or no stop could be noted down."""
        if self.file.exists():
            why = " ".join(self.file.read_text(encoding="utf-8").split())
            raise InputError(
                f"the robot was stopped ({why}): see to it, then remove {self.file} to go on"
            )
        if not os.access(self.file.parent, os.W_OK):
            raise InputError(f"{self.file.parent} must be writable: a stop is noted down there")

    def close(self, why: object) -> None:
        """Note down that it was stopped; the first reason stays."""
        if not self.file.exists():
            when = datetime.now().astimezone().isoformat(timespec="seconds")
            self.file.write_text(f"{when}: {why}\n", encoding="utf-8")
