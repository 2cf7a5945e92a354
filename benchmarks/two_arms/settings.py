"""The options that measurements of the two arms share."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """Which world, and how long a run is."""

    task: Path = Path("examples/aloha/tune.toml")
    """The example's tuning file; examples/aloha/prepare.sh unpacks its scene."""
    seed: int = 0
    """Of the world and of what the arms do."""
    minutes: float = 10.0
    """Each run's --budget-minutes."""
    episodes: int = 6
    """Of the world."""
    steps: int = 200
    """Of each episode."""
    record: Path | None = None
    """Write the figures into this file of docs/results, too."""
