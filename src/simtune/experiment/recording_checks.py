"""What `simtune check` would say of a run's recordings: looked at once, and kept with the run."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from simtune.checking.expected_precision import expected_precision
from simtune.checking.mistakes.misread import MOST_S
from simtune.experiment.experiment import Experiment
from simtune.names import search_traits
from simtune.tuning.search import TimeNeeded

# Of the budget: in which check may say what to expect, and look for mistakes in readings besides
_CHECK_SHARE, _MISTAKES_SHARE = 0.06, 0.05
_WITH_FILMS = 2  # times what check takes else, where it looks at films as well
_KEY = "checked"  # in a checkpoint


@dataclass(frozen=True)
class RecordingChecks:
    """What is known of the recordings so far; None: there was no time to look.

    A later session may be too short to look again, such as one that only ends an interrupted run.
    """

    films: list[str] | None = None  # warnings
    expected: dict[str, Any] | None = None  # {name: what the best fit could tell}; JSON
    of_readings: list[str] = field(default_factory=list)  # warnings

    @classmethod
    def kept(cls, state: Mapping[str, Any] | None) -> "RecordingChecks":
        """In a run's checkpoint; nothing without one, or what one of another version has of it."""
        held = (state or {}).get(_KEY, {})
        return cls(**{f.name: held[f.name] for f in fields(cls) if f.name in held})

    def to_keep(self) -> dict[str, Any]:
        """The inverse of `kept`: the part of a checkpoint; JSON."""
        return {_KEY: asdict(self)}

    def completed(
        self, experiment: Experiment, minutes: float, needed: TimeNeeded
    ) -> "RecordingChecks":
        """With what is missing, if it takes little of a budget of `minutes`."""
        most_s, found = _CHECK_SHARE * 60 * minutes, self
        if found.films is None and _WITH_FILMS * needed.check_s < most_s:
            found = replace(found, films=experiment.film_warnings())
        gives_intervals = search_traits(experiment.search_name).has_intervals
        if found.expected is None and gives_intervals and needed.check_s < most_s:
            found = found._with_expected(experiment, minutes)
        return found

    def _with_expected(self, experiment: Experiment, minutes: float) -> "RecordingChecks":
        simulator, seen = experiment.simulator, experiment.context.observation
        names = experiment.real.facts.get("names", ())
        real, seed = experiment.recordings, experiment.config.seed
        most_s = min(_MISTAKES_SHARE * 60 * minutes, MOST_S)
        found = expected_precision(simulator, seen, real, seed, names, most_s)
        return replace(self, expected=found.parameters, of_readings=found.warnings)

    @property
    def warnings(self) -> list[str]:
        return (self.films or []) + self.of_readings

    @property
    def in_result(self) -> dict[str, Any]:
        """The part of result.json."""
        return {"check": self.expected} if self.expected is not None else {}
