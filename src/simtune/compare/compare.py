"""`simtune compare`: whether two runs agree, within what each says of its own sureness.

With m and σ a run's median and standard deviation of a parameter, along its own scale (σ is that
of the normal distribution with the same central 90 %), runs a and b differ by

    z = (m_b − m_a) / √(σ_a² + σ_b²)

standard deviations. Were all intervals right and the errors of both runs independent and normal,
the largest |z| of N parameters would be above Φ⁻¹(1 − α_N / 2), with α_N = 1 − (1 − α)^(1/N), in at
most a share α of all pairs of runs, however the errors of one run go together (Šidák 1967).
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from simtune.config import CompareConfig
from simtune.errors import InputError
from simtune.report.data import RunData, read_finished

FALSE_ALARM_RATE = 0.05  # of pairs of runs that do agree
_SMALLEST_STD = 1e-6  # in unit coordinates


def compare(config: CompareConfig) -> dict[str, Any]:
    """How far the estimates of two runs are apart, and whether they agree; JSON.

    Raises InputError where runs have not ended, give no intervals, or are of other parameters.
    """
    one, other = read_finished(config.run_folder), read_finished(config.other_folder)
    before, now = _told(one), _told(other)
    _check_same(one, before, other, now)
    z = differences(before.mean, before.std, now.mean, now.std)
    worst, limit = int(np.argmax(np.abs(z))), largest_allowed(len(z), FALSE_ALARM_RATE)
    parameters = {
        name: {
            "estimates": [_numbers(run, name) for run in (one, other)],
            "difference_std": float(z[i]),
        }
        for i, name in enumerate(before.names)
    }
    return {
        "runs": [str(one.path), str(other.path)],
        "task": one.result["task"],
        "agree": bool(abs(z[worst]) <= limit),
        "largest": before.names[worst],
        "limit_std": limit,
        "false_alarm_rate": FALSE_ALARM_RATE,
        "p_value": p_value(float(z[worst]), len(z)),
        "notes": _notes(one, other),
        "parameters": parameters,
    }


def differences(
    mean: np.ndarray, std: np.ndarray, other_mean: np.ndarray, other_std: np.ndarray
) -> np.ndarray:
    """(N,) by how many standard deviations the second is above the first."""
    # Where a parameter is at its bound for sure, none is left.
    return (other_mean - mean) / np.maximum(np.hypot(std, other_std), _SMALLEST_STD)


def largest_allowed(num: int, rate: float) -> float:
    """Standard deviations that the largest of `num` differences exceeds with probability `rate`."""
    return float(-ndtri((1 - (1 - rate) ** (1 / num)) / 2))


def p_value(largest: float, num: int) -> float:
    """How often chance alone makes the largest of `num` differences at least as large."""
    return float(1 - (1 - 2 * ndtr(-abs(largest))) ** num)


class _Told(NamedTuple):
    """What result.json says of a run's parameters, in unit coordinates."""

    coordinates: list[dict[str, Any]]  # name, scale, low, high
    mean: np.ndarray  # (N,)
    std: np.ndarray  # (N,)

    @property
    def names(self) -> list[str]:
        return [c["name"] for c in self.coordinates]


def _told(run: RunData) -> _Told:
    if not run.is_tuned or run.result.get("search") != "posterior":
        how = run.result.get("search") or f"--method {run.result.get('method')}"
        raise InputError(f"{run.path} is of {how}, which gives no intervals to compare")
    if not (told := run.object("covariance")):
        raise InputError(
            f"{run.path} says nothing of covariance, since an earlier version wrote it: give its "
            "command once more"
        )
    try:
        coordinates = told["coordinates"]
        mean, matrix = (np.array(told[key], float) for key in ("mean", "matrix"))
        if matrix.shape != (len(coordinates), len(mean)) or not np.isfinite(matrix).all():
            raise ValueError("its covariance has no number for each pair of parameters")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{run.path / 'result.json'} is damaged: {error}") from None
    return _Told(coordinates, mean, np.sqrt(np.diag(matrix)))


def _check_same(one: RunData, before: _Told, other: RunData, now: _Told) -> None:
    """Raises InputError where the runs are not of the same parameters."""
    tasks = one.result["task"], other.result["task"]
    if tasks[0] != tasks[1]:
        raise InputError(
            f"{one.path} is of {tasks[0]}, {other.path} of {tasks[1]}: compare two runs of one task"
        )
    differing = [n for n in (*before.names, *now.names) if (n in before.names) != (n in now.names)]
    if differing:
        which = ", ".join(differing[:3]) + ", ..." * (len(differing) > 3)
        raise InputError(
            f"only one of {one.path} and {other.path} tuned {which}: compare two runs of the same "
            "parameters"
        )
    if before.coordinates != now.coordinates:
        pairs = zip(before.coordinates, now.coordinates, strict=True)
        name = next(a["name"] for a, b in pairs if a != b)
        raise InputError(
            f"{name} has other bounds, another scale or another place in {other.path} than in "
            f"{one.path}: compare two runs of one tuning file"
        )


def _notes(one: RunData, other: RunData) -> list[str]:
    """What to bear in mind: whether the runs saw the same, and tuned the same."""
    notes = []
    hashes = [run.object("recordings").get("dataset_hash") for run in (one, other)]
    if one.path.resolve() == other.path.resolve():
        notes.append("this is one and the same run")
    elif hashes[0] and hashes[0] == hashes[1]:
        notes.append(
            "both are of the same recordings, so their errors go together: that they agree says "
            "less than of other episodes"
        )
    if one.config.get("task_content") != other.config.get("task_content"):
        notes.append("the model or the tuning file is not the same in both")
    return notes


def _numbers(run: RunData, name: str) -> dict[str, Any]:
    return {key: run.parameters[name].get(key) for key in ("mean", "low", "high", "verdict")}
