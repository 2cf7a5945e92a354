"""A run's estimate of one parameter."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from simtune.errors import UnknownName


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A run's estimate of one parameter; all numbers are in its unit."""

    name: str
    unit: str  # "1": a pure number; "×": a factor on the nominal values
    nominal: float  # value in the original model
    initial: float  # start of the search
    mean: float  # the estimate
    low: float  # ends of the 90 % interval; of the searched range if the search gives none
    high: float
    interval_share: float | None  # width of the interval, as a share of the first searched range
    verdict: str  # depends on that share: identified, weak, not identifiable
    real: float | None  # the truth, in a pseudo-real world
    percent_error: float | None

    @classmethod
    def read(cls, name: str, facts: Mapping[str, Any]) -> "ParameterEstimate":
        """From a parameter's facts in result.json; missing ones become None."""
        names = [field.name for field in fields(cls)]
        known: dict[str, Any] = dict.fromkeys(names) | {**facts, "name": name}
        return cls(**{key: known[key] for key in names})


class ParameterEstimates(dict[str, ParameterEstimate]):
    """{name: estimate} of a run; the KeyError of another name says what there is."""

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]], run: str, text: str, html: str):
        """`text` and `html`: the table that shows them."""
        super().__init__({name: ParameterEstimate.read(name, p) for name, p in parameters.items()})
        self._run, self._text, self._html = run, text, html

    def __repr__(self) -> str:
        return self._text

    def _repr_html_(self) -> str:
        return self._html

    def __missing__(self, name: str) -> ParameterEstimate:
        raise KeyError(str(UnknownName("parameter", name, self._run, self)))
