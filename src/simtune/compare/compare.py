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
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri

from simtune.columns import cut
from simtune.compare.estimates import in_common, read_estimates
from simtune.config import CompareConfig
from simtune.run_data import RunData, read_finished

_MOST_NAMED = 5  # parameters that a run does not tell
FALSE_ALARM_RATE = 0.05  # share of sets of runs that agree but are reported to disagree
_SMALLEST_STD = 1e-6  # in unit coordinates
_SMALLEST_PROBABILITY = 1e-300  # a normal deviate of 37


def compare(config: CompareConfig) -> dict[str, Any]:
    """The differences between runs' estimates, and whether the runs agree; JSON.

    Of what all runs tuned. "told" names the parameters of which no run says "not identifiable":
    only there does it mean anything that runs agree. Raises InputError if a run has not ended or
    gives no intervals, or if they have no parameter in common.
    """
    config.check()
    runs = [read_finished(folder) for folder in config.run_folders]
    estimates, notes = in_common(runs, [read_estimates(run) for run in runs])
    names = list(estimates[0].coordinates)
    z = differences(np.array([e.mean for e in estimates]), np.array([e.std for e in estimates]))
    worst, limit = int(np.argmax(np.abs(z))), largest_allowed(len(z), FALSE_ALARM_RATE)
    parameters = {
        name: {
            "estimates": [_numbers(run, name) for run in runs],
            "difference_std": float(z[i]),
        }
        for i, name in enumerate(names)
    }
    return {
        "runs": [str(run.path) for run in runs],
        "task": runs[0].result["task"],
        "agree": bool(abs(z[worst]) <= limit),
        "told": [name for name in names if not any(_is_unknown(run, name) for run in runs)],
        "largest": names[worst],
        "limit_std": limit,
        "false_alarm_rate": FALSE_ALARM_RATE,
        "p_value": p_value(float(z[worst]), len(z)),
        "notes": notes + _notes(runs, names),
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


def _notes(runs: list[RunData], names: list[str]) -> list[str]:
    """Caveats: runs of the same recordings, of two worlds, or of different models.

    `names`: of the parameters that are compared.
    """
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
        if unknown := [name for name in names if _is_unknown(run, name)]:
            of_them = f"run {i + 1} does not tell {cut(unknown, _MOST_NAMED)}"
            notes.append(f"{of_them}: that it agrees there says nothing")
    if any(a.config.get("task_content") != b.config.get("task_content") for a, b in pairwise(runs)):
        notes.append("the model or the tuning file is not the same in all runs")
    return notes


def _is_unknown(run: RunData, name: str) -> bool:
    return run.parameters[name].get("verdict") == "not identifiable"


def _saw_the_same(a: RunData, b: RunData) -> bool:
    """Whether runs read an episode of the same recordings, or filmed a pseudo-real world alike."""
    one, other = a.object("recordings"), b.object("recordings")
    if digest := one.get("dataset_hash"):
        are_apart = set(one.get("names", ())).isdisjoint(other.get("names", ()))
        has_names = "names" in one and "names" in other
        return digest == other.get("dataset_hash") and not (has_names and are_apart)
    is_pseudo = a.config.get("real") == "pseudo" and bool(a.config.get("truth"))
    filmed_by = ("real", "truth", "seed", "real_gap", "method")  # a policy films as it acts
    return is_pseudo and all(a.config.get(key) == b.config.get(key) for key in filmed_by)


def _numbers(run: RunData, name: str) -> dict[str, Any]:
    return {key: run.parameters[name].get(key) for key in ("mean", "low", "high", "verdict")}
