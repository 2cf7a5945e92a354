"""`simtune compare`: tests whether runs agree within their own uncertainties.

Let m_k and σ_k be run k's median and standard deviation of a parameter, along its own scale (σ is
that of the normal distribution with the same central 90 %). The difference of K runs is

    χ² = Σ_k (m_k − μ)² / σ_k²,  μ = Σ_k (m_k / σ_k²) / Σ_k (1 / σ_k²)

with K − 1 degrees of freedom (Cochran 1937), expressed as the normal deviate z of the same
probability; for two runs, z = (m_2 − m_1) / √(σ_1² + σ_2²). If all intervals are right and the
runs' errors are independent and normal, the largest |z| of N parameters exceeds Φ⁻¹(1 − α_N / 2),
with α_N = 1 − (1 − α)^(1/N), in at most a share α of such sets of runs, however the errors within a
run are correlated (Šidák 1967).
"""

from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri

from simtune.config import CompareConfig
from simtune.errors import InputError
from simtune.report.data import RunData
from simtune.report.read_run import read_finished

_MOST_NAMED = 5  # parameters that a run does not tell
FALSE_ALARM_RATE = 0.05  # share of sets of runs that agree but are reported to disagree
_SMALLEST_STD = 1e-6  # in unit coordinates
_SMALLEST_PROBABILITY = 1e-300  # a normal deviate of 37


def compare(config: CompareConfig) -> dict[str, Any]:
    """The differences between runs' estimates, and whether the runs agree; JSON.

    Raises InputError if a run has not ended or gives no intervals, or if parameters differ.
    """
    config.check()
    runs = [read_finished(folder) for folder in config.run_folders]
    estimates = [_read_estimates(run) for run in runs]
    for run, other in zip(runs[1:], estimates[1:], strict=True):
        _check_same(runs[0], estimates[0], run, other)
    z = differences(np.array([e.mean for e in estimates]), np.array([e.std for e in estimates]))
    worst, limit = int(np.argmax(np.abs(z))), largest_allowed(len(z), FALSE_ALARM_RATE)
    parameters = {
        name: {
            "estimates": [_numbers(run, name) for run in runs],
            "difference_std": float(z[i]),
        }
        for i, name in enumerate(estimates[0].names)
    }
    return {
        "runs": [str(run.path) for run in runs],
        "task": runs[0].result["task"],
        "agree": bool(abs(z[worst]) <= limit),
        "largest": estimates[0].names[worst],
        "limit_std": limit,
        "false_alarm_rate": FALSE_ALARM_RATE,
        "p_value": p_value(float(z[worst]), len(z)),
        "notes": _notes(runs),
        "parameters": parameters,
    }


def differences(mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(N,) difference of K runs in each parameter, in standard deviations.

    `mean` and `std`: (K, N). For two runs, it is negative if the second is below the first.
    """
    if len(mean) == 2:
        # The standard deviation may be 0, for a parameter that is certainly at its bound.
        return (mean[1] - mean[0]) / np.maximum(np.hypot(*std), _SMALLEST_STD)
    weight = 1 / np.maximum(std, _SMALLEST_STD) ** 2
    apart = mean - (weight * mean).sum(0) / weight.sum(0)
    probability = chdtrc(len(mean) - 1, (weight * apart**2).sum(0))
    return -ndtri(np.maximum(probability, _SMALLEST_PROBABILITY) / 2)


def largest_allowed(num: int, rate: float) -> float:
    """Limit, in standard deviations, that the largest of `num` differences exceeds with
    probability `rate`.
    """
    return float(-ndtri((1 - (1 - rate) ** (1 / num)) / 2))


def p_value(largest: float, num: int) -> float:
    """Probability that the largest of `num` differences is at least `largest` by chance."""
    return float(1 - (1 - 2 * ndtr(-abs(largest))) ** num)


class _Estimates(NamedTuple):
    """A run's estimates from result.json, in unit coordinates."""

    coordinates: list[dict[str, Any]]  # name, scale, low, high
    mean: np.ndarray  # (N,)
    std: np.ndarray  # (N,)

    @property
    def names(self) -> list[str]:
        return [c["name"] for c in self.coordinates]


def _read_estimates(run: RunData) -> _Estimates:
    """A run's estimates. Raises InputError if it has no intervals or is damaged."""
    if not run.is_tuned or run.result.get("search") != "posterior":
        how = run.result.get("search") or f"--method {run.result.get('method')}"
        raise InputError(f"{run.path} is of {how}, which gives no intervals to compare")
    if not (stored := run.object("covariance")):
        raise InputError(
            f"{run.path} says nothing of covariance, since an earlier version wrote it: give its "
            "command once more"
        )
    try:
        coordinates = stored["coordinates"]
        mean, matrix = (np.array(stored[key], float) for key in ("mean", "matrix"))
        if matrix.shape != (len(coordinates), len(mean)) or not np.isfinite(matrix).all():
            raise ValueError("its covariance has no number for each pair of parameters")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{run.path / 'result.json'} is damaged: {error}") from None
    return _Estimates(coordinates, mean, np.sqrt(np.diag(matrix)))


def _check_same(run_a: RunData, a: _Estimates, run_b: RunData, b: _Estimates) -> None:
    """Raises InputError if the runs have different parameters."""
    tasks = run_a.result["task"], run_b.result["task"]
    if tasks[0] != tasks[1]:
        raise InputError(
            f"{run_a.path} is of {tasks[0]}, {run_b.path} of {tasks[1]}: compare runs of one task"
        )
    differing = [n for n in (*a.names, *b.names) if (n in a.names) != (n in b.names)]
    if differing:
        which = ", ".join(differing[:3]) + ", ..." * (len(differing) > 3)
        raise InputError(
            f"only one of {run_a.path} and {run_b.path} tuned {which}: compare runs of the same "
            "parameters"
        )
    if a.coordinates != b.coordinates:
        pairs = zip(a.coordinates, b.coordinates, strict=True)
        name = next(in_a["name"] for in_a, in_b in pairs if in_a != in_b)
        raise InputError(
            f"{name} has other bounds, another scale or another place in {run_b.path} than in "
            f"{run_a.path}: compare runs of one tuning file"
        )


def _notes(runs: list[RunData]) -> list[str]:
    """Caveats: runs of the same recordings, of two worlds, or of different models."""
    notes = []
    for i, k in combinations(range(len(runs)), 2):
        if runs[i].path.resolve() == runs[k].path.resolve():
            notes.append(f"runs {i + 1} and {k + 1} are one and the same")
        elif _saw_the_same(runs[i], runs[k]):
            notes.append(
                f"runs {i + 1} and {k + 1} are of the same recordings, so their errors go "
                "together: that they agree says less than of other episodes"
            )
        elif len({truth for run in (runs[i], runs[k]) if (truth := run.config.get("truth"))}) > 1:
            notes.append(
                f"runs {i + 1} and {k + 1} are of pseudo-real worlds with different true parameters"
            )
    for i, run in enumerate(runs):
        told = run.parameters
        if unknown := [n for n in told if told[n].get("verdict") == "not identifiable"]:
            of_them = ", ".join(unknown[:_MOST_NAMED]) + ", ..." * (len(unknown) > _MOST_NAMED)
            notes.append(f"run {i + 1} does not tell {of_them}: that it agrees there says nothing")
    if any(a.config.get("task_content") != b.config.get("task_content") for a, b in pairwise(runs)):
        notes.append("the model or the tuning file is not the same in all runs")
    return notes


def _saw_the_same(a: RunData, b: RunData) -> bool:
    """Whether runs read the same recordings, or filmed one pseudo-real world alike."""
    if digest := a.object("recordings").get("dataset_hash"):
        return digest == b.object("recordings").get("dataset_hash")
    is_pseudo = a.config.get("real") == "pseudo" and bool(a.config.get("truth"))
    filmed_by = ("real", "truth", "seed", "real_gap", "method")  # a policy films as it acts
    return is_pseudo and all(a.config.get(key) == b.config.get(key) for key in filmed_by)


def _numbers(run: RunData, name: str) -> dict[str, Any]:
    return {key: run.parameters[name].get(key) for key in ("mean", "low", "high", "verdict")}
