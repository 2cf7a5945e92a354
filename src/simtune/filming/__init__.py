"""`simtune record`: film a task's world into a LeRobotDataset v3."""

from simtune.filming.cameras import filming_whole
from simtune.filming.film import record

__all__ = ["filming_whole", "record"]
