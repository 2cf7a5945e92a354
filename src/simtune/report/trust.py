"""How far to trust the estimates: what known worlds showed, and what goes together."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from simtune.report.data import RunData
from simtune.validate import is_number

_POSE = ("x", "y", "z", "pitch", "yaw", "roll")
_KINDS = {"ratio": "/", "product": "·", "difference": "−", "sum": "+"}


def ranks(run: RunData) -> dict[str, list[float]]:
    """Of the truths in known worlds, by parameter; whatever else is in their place is left out."""
    given = {n: listed for n, listed in run.object("ranks").items() if isinstance(listed, list)}
    found = {n: [r for r in listed if is_number(r) and 0 <= r <= 1] for n, listed in given.items()}
    return {name: listed for name, listed in found.items() if listed}


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two parameters that can hardly be told from each other."""

    a: str
    b: str
    correlation: float
    combination: dict[str, Any] | None  # what is told best, see tuning.combinations; None: neither

    @property
    def operator(self) -> str:
        """Between a and b."""
        return _KINDS[self.combination["kind"]] if self.combination else ""

    @property
    def is_power(self) -> bool:
        """Whether b is raised to its weight; it is multiplied by it else."""
        return self.operator in ("/", "·")

    def real(self, run: RunData) -> float | None:
        """What the combination is in truth, where that is known and positive if it has to be."""
        a, b = (run.parameters[name].get("real") for name in (self.a, self.b))
        if not self.combination or not is_number(a) or not is_number(b):
            return None
        sign = 1 if self.operator in ("·", "+") else -1
        weight = sign * self.combination["weight"]
        if not self.is_power:
            return a + weight * b
        return a * b**weight if a > 0 and b > 0 else None


def poses(run: RunData) -> dict[str, list[str]]:
    """{camera pose: parameters that go together with it}, of kind "camera_pose"."""
    found: dict[str, list[str]] = {stem: [] for stem in _stems(run)}
    for a, b, _ in _correlated(run):
        for one, other in ((a, b), (b, a)):
            stem = _pose_of(one, found)
            if stem and not _pose_of(other, found) and other not in found[stem]:
                found[stem].append(other)
    return found


def pairs(run: RunData) -> list[Pair]:
    """Those that go together most first; without cameras' poses, whose numbers always do."""
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
    """NAME of each NAME_x to NAME_roll among the parameters."""
    stems = [name.removesuffix("_x") for name in run.parameters if name.endswith("_x")]
    return [stem for stem in stems if all(f"{stem}_{axis}" in run.parameters for axis in _POSE)]


def _pose_of(name: str, stems: Iterable[str]) -> str:
    """The pose that has this number; empty for none."""
    stem, _, axis = name.rpartition("_")
    return stem if axis in _POSE and stem in stems else ""


def _sound(told: list[Any]) -> list[dict[str, Any]]:
    numbers = ("weight", "mean", "low", "high")
    found = [c for c in told if isinstance(c, dict) and c.get("kind") in tuple(_KINDS)]
    return [c for c in found if all(is_number(c.get(key)) for key in numbers)]
