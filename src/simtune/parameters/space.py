"""An ordered set of parameters: vectors (N,) and their unit-cube coordinates."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from simtune.columns import aligned
from simtune.errors import InputError, UnknownName
from simtune.parameters.parameter import Parameter
from simtune.validate import is_number


class ParameterSpace:
    """The tunable parameters of one simulator, in a fixed order.

    A vector of parameters has shape (..., N). `to_unit` maps it to [0, 1]^N, along each
    parameter's own scale; the search and the networks use these coordinates. Messages say `where`
    a parameter is missing.
    """

    def __init__(self, parameters: Iterable[Parameter], where: str = "this simulator"):
        self.where = where
        self.parameters = tuple(parameters)
        self.names = tuple(p.name for p in self.parameters)
        if len(set(self.names)) < len(self.names):
            twice = next(n for n in self.names if self.names.count(n) > 1)
            raise InputError(f"parameter {twice!r} is declared twice")
        self.nominal = np.array([p.nominal for p in self.parameters])  # (N,)
        self.low = np.array([p.low for p in self.parameters])
        self.high = np.array([p.high for p in self.parameters])
        self.is_log = np.array([p.scale == "log" for p in self.parameters], bool)
        self.is_colour = np.array([p.is_colour for p in self.parameters], bool)
        self.is_visible = np.array([p.is_visible for p in self.parameters], bool)
        self.is_appearance = np.array([p.is_appearance for p in self.parameters], bool)
        self.is_delay = np.array([p.is_delay for p in self.parameters], bool)

    def __len__(self) -> int:
        return len(self.parameters)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __getitem__(self, name: str) -> Parameter:
        return self.parameters[self.index(name)]

    def __repr__(self) -> str:
        """A table, a line for each."""
        rows: list[tuple[str, ...]] = [("parameter", "unit", "nominal", "low", "high", "scale")]
        for p in self.parameters:
            numbers = (f"{value:.4g}" for value in (p.nominal, p.low, p.high))
            rows.append((p.name, p.unit, *numbers, p.scale))
        return "\n".join(aligned(rows, left=(0, 1, 5)))

    def index(self, name: str) -> int:
        """Position of a parameter. Raises UnknownName."""
        if name not in self.names:
            raise UnknownName("parameter", name, self.where, self.names)
        return self.names.index(name)

    def clip(self, values: np.ndarray) -> np.ndarray:
        """(..., N) values moved into the bounds."""
        return np.clip(values, self.low, self.high)

    def to_unit(self, values: np.ndarray) -> np.ndarray:
        """(..., N) values to coordinates: 0 at low, 1 at high, along each scale."""
        values = np.asarray(values, float)
        spread = self._spread(values)
        low, high = self._spread(self.low), self._spread(self.high)
        return (spread - low) / (high - low)

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """The inverse of `to_unit`; coordinates outside [0, 1] are clipped to the bounds."""
        low, high = self._spread(self.low), self._spread(self.high)
        spread = low + np.clip(np.asarray(unit, float), 0, 1) * (high - low)
        return self.clip(np.where(self.is_log, np.exp(np.where(self.is_log, spread, 0)), spread))

    def _spread(self, values: np.ndarray) -> np.ndarray:
        positive = np.where(self.is_log, np.maximum(values, 1e-300), 1.0)
        return np.where(self.is_log, np.log(positive), values)

    def to_dict(self, values: np.ndarray) -> dict[str, float]:
        """{name: value} of one vector (N,)."""
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}

    def from_dict(self, values: Mapping[str, Any]) -> np.ndarray:
        """A vector (N,) from {name: value}; parameters not named are nominal.

        Raises UnknownName, and InputError for values that are not finite numbers within the bounds.
        """
        vector = self.nominal.copy()
        for name, value in values.items():
            parameter = self[name]
            if not is_number(value):
                raise InputError(f"parameter {name!r} must be a finite number, got {value!r:.60}")
            if not parameter.low <= value <= parameter.high:
                raise InputError(
                    f"parameter {name!r} must lie in [{parameter.low:g}, {parameter.high:g}] "
                    f"{parameter.unit}, got {value:g}"
                )
            vector[self.index(name)] = value
        return vector
