"""`simtune compare`: whether runs agree, within what each says of its own sureness.

With m_k and σ_k run k's median and standard deviation of a parameter, along its own scale (σ is
that of the normal distribution with the same central 90 %), K runs are apart by

    χ² = Σ_k (m_k − μ)² / σ_k²,  μ = Σ_k (m_k / σ_k²) / Σ_k (1 / σ_k²)

with K − 1 degrees of freedom (Cochran 1937), told as the normal deviate z that is as improbable; of
two runs that is z = (m_2 − m_1) / √(σ_1² + σ_2²). Were all intervals right and the errors of the
runs independent and normal, the largest |z| of N parameters would be above Φ⁻¹(1 − α_N / 2), with
α_N = 1 − (1 − α)^(1/N), in at most a share α of such sets of runs, however the errors of one run go
together (Šidák 1967).
"""

from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri

from simtune.config import CompareConfig
from simtune.errors import InputError
from simtune.report.data import RunData, read_finished

FALSE_ALARM_RATE = 0.05  # of sets of runs that do agree
_SMALLEST_STD = 1e-6  # in unit coordinates
_SMALLEST_PROBABILITY = 1e-300  # a normal deviate of 37


def compare(config: CompareConfig) -> dict[str, Any]:
    """How far the estimates of runs are apart, and whether they agree; JSON.

    Raises InputError where runs have not ended, give no intervals, or are of other parameters.
    """
    config.check()
    runs = [read_finished(folder) for folder in config.run_folders]
    told = [_told(run) for run in runs]
    for run, says in zip(runs[1:], told[1:], strict=True):
        _check_same(runs[0], told[0], run, says)
    z = differences(np.array([t.mean for t in told]), np.array([t.std for t in told]))
    worst, limit = int(np.argmax(np.abs(z))), largest_allowed(len(z), FALSE_ALARM_RATE)
    parameters = {
        name: {
            "estimates": [_numbers(run, name) for run in runs],
            "difference_std": float(z[i]),
        }
        for i, name in enumerate(told[0].names)
    }
    return {
        "runs": [str(run.path) for run in runs],
        "task": runs[0].result["task"],
        "agree": bool(abs(z[worst]) <= limit),
        "largest": told[0].names[worst],
        "limit_std": limit,
        "false_alarm_rate": FALSE_ALARM_RATE,
        "p_value": p_value(float(z[worst]), len(z)),
        "notes": _notes(runs),
        "parameters": parameters,
    }


def differences(mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(N,) by how many standard deviations K runs, (K, N) each, are apart in each parameter.

    Of two, negative where the second is below the first.
    """
    if len(mean) == 2:
        # Where a parameter is at its bound for sure, no deviation is left.
        return (mean[1] - mean[0]) / np.maximum(np.hypot(*std), _SMALLEST_STD)
    weight = 1 / np.maximum(std, _SMALLEST_STD) ** 2
    apart = mean - (weight * mean).sum(0) / weight.sum(0)
    probability = chdtrc(len(mean) - 1, (weight * apart**2).sum(0))
    return -ndtri(np.maximum(probability, _SMALLEST_PROBABILITY) / 2)


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
            f"{one.path} is of {tasks[0]}, {other.path} of {tasks[1]}: compare runs of one task"
        )
    differing = [n for n in (*before.names, *now.names) if (n in before.names) != (n in now.names)]
    if differing:
        which = ", ".join(differing[:3]) + ", ..." * (len(differing) > 3)
        raise InputError(
            f"only one of {one.path} and {other.path} tuned {which}: compare runs of the same "
            "parameters"
        )
    if before.coordinates != now.coordinates:
        pairs = zip(before.coordinates, now.coordinates, strict=True)
        name = next(a["name"] for a, b in pairs if a != b)
        raise InputError(
            f"{name} has other bounds, another scale or another place in {other.path} than in "
            f"{one.path}: compare runs of one tuning file"
        )


def _notes(runs: list[RunData]) -> list[str]:
    """What to bear in mind: whether runs saw the same, and tuned the same."""
    notes = []
    hashes = [run.object("recordings").get("dataset_hash") for run in runs]
    for i, k in combinations(range(len(runs)), 2):
        if runs[i].path.resolve() == runs[k].path.resolve():
            notes.append(f"runs {i + 1} and {k + 1} are one and the same")
        elif hashes[i] and hashes[i] == hashes[k]:
            notes.append(
                f"runs {i + 1} and {k + 1} are of the same recordings, so their errors go "
                "together: that they agree says less than of other episodes"
            )
    if any(a.config.get("task_content") != b.config.get("task_content") for a, b in pairwise(runs)):
        notes.append("the model or the tuning file is not the same in all runs")
    return notes


def _numbers(run: RunData, name: str) -> dict[str, Any]:
    return {key: run.parameters[name].get(key) for key in ("mean", "low", "high", "verdict")}
