"""Trust in the estimates: known truths, replays, ranks in known worlds, correlated parameters."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from simtune.run_data import RunData
from simtune.validate import is_number

_POSE = ("x", "y", "z", "pitch", "yaw", "roll")
CLEARLY = 1.1  # ratio of what is left after tuning to what was before
_KINDS = {"ratio": "/", "product": "·", "difference": "−", "sum": "+"}


def holds_truth(facts: Mapping[str, Any]) -> bool | None:
    """Whether a parameter's interval holds its truth; None if either is unknown."""
    low, truth, high = (facts.get(key) for key in ("low", "real", "high"))
    if not (is_number(low) and is_number(truth) and is_number(high)):
        return None
    return low <= truth <= high


def mean_error(parameters: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Mean of the estimates' percent errors; None if no truth is known."""
    errors = [facts.get("percent_error") for facts in parameters.values()]
    known = [error for error in errors if is_number(error)]
    return sum(known) / len(known) if known else None


def num_holding(parameters: Mapping[str, Mapping[str, Any]]) -> tuple[int, int]:
    """(intervals that hold their truth, intervals whose truth is known)."""
    held = [holds for facts in parameters.values() if (holds := holds_truth(facts)) is not None]
    return sum(held), len(held)


def readings_farther(readings: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Joint readings that are clearly farther off after tuning than before.

    Of {reading: its "rms_before" and "rms" over all episodes}. Where replays before tuning diverge,
    which are left out of its "rms_before", nothing is.
    """
    found = []
    for label, facts in readings.items():
        before, after = facts.get("rms_before"), facts.get("rms")
        if facts.get("diverged_before") or not (is_number(before) and is_number(after)):
            continue
        if after > CLEARLY * before:
            found.append(label)
    return found


def ranks(run: RunData) -> dict[str, list[float]]:
    """{parameter: ranks of the truths in known worlds}; invalid entries are left out."""
    given = {n: listed for n, listed in run.object("ranks").items() if isinstance(listed, list)}
    found = {n: [r for r in listed if is_number(r) and 0 <= r <= 1] for n, listed in given.items()}
    return {name: listed for name, listed in found.items() if listed}


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two parameters that can hardly be distinguished."""

    a: str
    b: str
    correlation: float
    # The combination of both that is known best, see tuning.combinations; None: there is none
    combination: dict[str, Any] | None

    @property
    def operator(self) -> str:
        """The operator between a and b in the combination."""
        return _KINDS[self.combination["kind"]] if self.combination else ""

    @property
    def is_power(self) -> bool:
        """Whether b is raised to the power of its weight, rather than multiplied by it."""
        return self.operator in ("/", "·")

    def real(self, run: RunData) -> float | None:
        """True value of the combination; None if unknown, or if a power needs positive values."""
        a, b = (run.parameters[name].get("real") for name in (self.a, self.b))
        if not self.combination or not is_number(a) or not is_number(b):
            return None
        sign = 1 if self.operator in ("·", "+") else -1
        weight = sign * self.combination["weight"]
        if not self.is_power:
            return a + weight * b
        return a * b**weight if a > 0 and b > 0 else None


def poses(run: RunData) -> dict[str, list[str]]:
    """{camera pose: other parameters correlated with it}, for kind "camera_pose"."""
    found: dict[str, list[str]] = {stem: [] for stem in _stems(run)}
    for a, b, _ in _correlated(run):
        for name, other in ((a, b), (b, a)):
            stem = _pose_of(name, found)
            if stem and not _pose_of(other, found) and other not in found[stem]:
                found[stem].append(other)
    return found


def pairs(run: RunData) -> list[Pair]:
    """Correlated pairs, strongest first; without camera poses, which are always correlated."""
    stems, told = _stems(run), run.result.get("combinations")
    combined = {(c.get("a"), c.get("b")): c for c in _sound(told if isinstance(told, list) else [])}
    found = [
        Pair(a=a, b=b, correlation=value, combination=combined.get((a, b)))
        for a, b, value in _correlated(run)
        if not _pose_of(a, stems) and not _pose_of(b, stems)
    ]
    return sorted(found, key=lambda pair: -abs(pair.correlation))


def _correlated(run: RunData) -> list[tuple[str, str, float]]:
    known, found = run.parameters, []
    for names, value in run.object("correlations").items():
        a, _, b = names.partition(", ")
        if a in known and b in known and is_number(value):
            found.append((a, b, value))
    return found


def _stems(run: RunData) -> list[str]:
    """Names NAME for which NAME_x to NAME_roll are all parameters."""
    stems = [name.removesuffix("_x") for name in run.parameters if name.endswith("_x")]
    return [stem for stem in stems if all(f"{stem}_{axis}" in run.parameters for axis in _POSE)]


def _pose_of(name: str, stems: Iterable[str]) -> str:
    """The camera pose to which a parameter belongs; "" if none."""
    stem, _, axis = name.rpartition("_")
    return stem if axis in _POSE and stem in stems else ""


def _sound(told: list[Any]) -> list[dict[str, Any]]:
    numbers = ("weight", "mean", "low", "high")
    found = [c for c in told if isinstance(c, dict) and c.get("kind") in tuple(_KINDS)]
    return [c for c in found if all(is_number(c.get(key)) for key in numbers)]
