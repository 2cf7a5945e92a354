"""The option for a command's output."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Prints:
    """The option of every command."""

    json: bool = False
    """Print one JSON object, and nothing else."""
