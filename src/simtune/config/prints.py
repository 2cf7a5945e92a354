"""How a command says what it found."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Prints:
    """What every command takes."""

    json: bool = False
    """Print one JSON object, and nothing else."""
