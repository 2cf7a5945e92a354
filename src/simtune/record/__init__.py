"""`simtune record`: film a task's world into a LeRobotDataset v3."""

from simtune.record.cameras import filming_whole
from simtune.record.film import record

__all__ = ["filming_whole", "record"]
