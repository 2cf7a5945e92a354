"""Interface of a sensor."""

from typing import Any, Protocol

import numpy as np

from simtune.observation.evidence import Evidence


class Sensor(Protocol):
    """A measurement of the real world beside its pictures, such as joint angles.

    Trajectories hold its readings, (T + 1, D), under its name.
    """

    @property
    def name(self) -> str: ...

    @property
    def labels(self) -> tuple[str, ...]:
        """(D,) names of a reading's numbers."""
        ...

    @property
    def size(self) -> int:
        """D, numbers in a reading."""
        ...

    def observe(self, batch: Any) -> np.ndarray:
        """(n, D) noise-free measurements of n simulated worlds' present state."""
        ...

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of recordings that hold its readings."""
        ...

    @property
    def periods(self) -> np.ndarray:
        """(D,) after which recorded readings may begin again, in their units; infinite: never."""
        ...

    def from_recorded(self, recorded: np.ndarray, step_s: float) -> np.ndarray:
        """(T + 1, D) readings, at the times of the frames.

        `recorded`: as they were written, but counted on where they begin again.
        """
        ...

    def to_recorded(self, readings: np.ndarray) -> np.ndarray:
        """(..., D) as they are written."""
        ...

    def measure(self, observed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(..., D) noise-free observations with the real sensor's noise added."""
        ...

    def evidence(self, readings: np.ndarray) -> Evidence:
        """Evidence from (E, T + 1, D) readings."""
        ...
