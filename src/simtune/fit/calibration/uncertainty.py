"""Uncertainty of a fit: intervals widened by its bootstrap, correlations, model checks."""

from dataclasses import replace
from typing import Any

import numpy as np

from simtune.fit.calibration.bootstrap import Bootstrap
from simtune.fit.result import FitResult, diluted
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution

_WORTH_TELLING = 0.6  # correlation from which a pair is reported
# Ratio to the worst refit's misfit; with few refits their worst is not very large yet.
_DOUBTFUL, _DOUBTFUL_OF_ONE = 1.6, 1.8
_CLEARLY_LATE_STDS, _CLEARLY_LATE_S = 4.0, 1e-3  # both exceeded: pictures are reported as late

_AT_BOUND = 1e-3  # in unit coordinates

_TOO_LATE = (
    "{} come {:.0f} ms {}, the most that is fitted: the rest of a delay may pass for damping, so "
    "nothing is called identified. Correct their times, or declare a parameter of kind delay."
)
_GO_ON = "Give it more minutes: the same command with a larger budget goes on from here."
_HARDLY_JUDGED = (
    "A single known world was fitted for comparison, so intervals lean on how far fits usually "
    f"are off. {_GO_ON}"
)
_NOT_JUDGED = (
    "There was no time to fit a known world for comparison, so nothing tells how far what videos "
    f"say can be trusted: none of it is called identified. {_GO_ON}"
)
_NOTHING_FOUND = (
    "In the known worlds fitted for comparison nothing that moves is found for sure, so how well "
    "the simulator moves as the videos do cannot be tested: none of it is called identified. Film "
    "what moves larger."
)


def calibrated(fit: FitResult, bootstrap: Bootstrap, space: ParameterSpace) -> FitResult:
    """The fit with bias removed, and with the standard deviations that refits show.

    These include what fits like this usually claim; they grow if this one explains the motion, or
    the pixels that show a parameter, worse than the refits do. Then less of the bias is removed,
    since something else is wrong. The motion's discrepancy is added in the end: refits have none,
    so they must not scale it down; it is independent between parameters, and dilutes correlations.
    """
    worse = np.full(len(fit.std), max(1.0, *bootstrap.motion_ratios(fit.misfit)))
    # A fit to pictures claims more where pixels are noisier, but `believed` takes half of it away.
    noisier = np.maximum(1.0, bootstrap.picture_ratios(fit.misfit))
    worse[~fit.is_moving] = np.sqrt(noisier)
    believed, refitted = bootstrap.believed(fit.std), fit.refitted_discrepancy_std
    unit = space.to_unit(fit.parameters) - bootstrap.bias() * np.hypot(believed, refitted) / worse
    inflation = bootstrap.inflation()
    std = inflation * np.hypot(believed * worse, refitted)
    std = np.where(
        fit.is_moving, np.hypot(std, fit.discrepancy_std), np.maximum(std, fit.discrepancy_std)
    )
    own, share = inflation * believed * worse, np.ones(len(std))
    np.divide(own, std, out=share, where=np.isfinite(std))
    correlation = diluted(fit.correlation, share)
    parameters = space.clip(space.from_unit(np.clip(unit, 0, 1)))
    return replace(fit, parameters=parameters, std=std, correlation=correlation)


def in_range(fit: FitResult, distribution: Distribution) -> tuple[np.ndarray, np.ndarray]:
    """(N,) means and standard deviations in coordinates of the range, 0 to 1."""
    return distribution.to_range_unit(fit.parameters), fit.std / distribution.unit_width


def tell_apart(correlation: np.ndarray, space: ParameterSpace) -> dict[str, float]:
    """{"a, b": correlation} of the pairs that can hardly be separated, of (N, N) correlations.

    Without pairs of colours of two channels.
    """
    found = {}
    for i, j in zip(*np.triu_indices(len(space), 1), strict=True):
        value, (a, b) = float(correlation[i, j]), (space.parameters[i], space.parameters[j])
        is_mixed = a.is_colour and b.is_colour and a.component != b.component
        if abs(value) >= _WORTH_TELLING and not is_mixed:
            found[f"{a.name}, {b.name}"] = round(value, 2)
    return found


def ranks(bootstrap: Bootstrap, names: tuple[str, ...]) -> dict[str, list[float]]:
    """{name: ranks of the refits' truths}."""
    if not len(bootstrap.errors):
        return {}
    return dict(zip(names, bootstrap.ranks().T.round(4).tolist(), strict=True))


def is_compared(bootstrap: Bootstrap) -> bool:
    """Whether known worlds tell how far off the motion of a right simulator is."""
    return any(np.isfinite(known.motion).any() for known in bootstrap.misfits)


def moves_otherwise(fit: FitResult, bootstrap: Bootstrap) -> bool:
    """Whether the motion misfit is far larger than in refits, where the simulator is right."""
    if not bootstrap.misfits:
        return False
    limit = _DOUBTFUL + _DOUBTFUL_OF_ONE / len(bootstrap.misfits)
    return bool(max(bootstrap.motion_ratios(fit.misfit)) > limit)


def model_checks(fit: FitResult, bootstrap: Bootstrap) -> list[str]:
    """Warnings for users who rely on the estimates."""
    if not bootstrap.misfits:
        return [_NOT_JUDGED, *_late(fit)]
    if not is_compared(bootstrap):
        return [_NOTHING_FOUND, *_late(fit)]
    warnings, num = [], len(bootstrap.misfits)
    if num == 1:
        warnings.append(_HARDLY_JUDGED)
    if moves_otherwise(fit, bootstrap):
        ratios = bootstrap.motion_ratios(fit.misfit)
        ratio, worst = max(ratios), int(np.argmax(ratios))
        (name, unit), distance = fit.sensors[worst], fit.misfit.motion[worst]
        found = (
            f"{name} are {distance:.2f} {unit} off, {ratio:.1f} times as far as"
            if np.isfinite(ratio)
            else "nothing that moves is found for sure, as it is"
        )
        warnings.append(
            "No setting of the parameters makes the simulator move as the videos do: where that "
            f"was tested {found} in worlds that the simulator can make. Something that "
            "is not tuned is wrong (a length, a mass, the camera, a delay): trust no number "
            "before it is found."
        )
    return warnings + _late(fit)


def held_out_misfit(fit: FitResult, bootstrap: Bootstrap) -> dict[str, Any]:
    """How well the fit explains the held-out episode; JSON.

    "episode" counts from 1; None: too few episodes. "passed": by `moves_otherwise`; None: nothing
    to compare with. Each sensor's "distance" is the fit's, next to those of known worlds.
    """
    known = [misfit.motion for misfit in bootstrap.misfits]
    passed = not moves_otherwise(fit, bootstrap) if is_compared(bootstrap) else None
    real, *others = ([_or_none(d) for d in motion] for motion in (fit.misfit.motion, *known))
    sensors = {
        name: {"unit": unit, "distance": real[i], "known_worlds": [world[i] for world in others]}
        for i, (name, unit) in enumerate(fit.sensors)
    }
    episode = None if fit.held_out is None else fit.held_out + 1
    return {"episode": episode, "passed": passed, "sensors": sensors}


def _or_none(distance: float) -> float | None:
    """JSON has no NaN."""
    return float(distance) if np.isfinite(distance) else None


def _late(fit: FitResult) -> list[str]:
    """Warnings of a latency of actions, and of late pictures where that is clear."""
    late = lateness_warning("pictures", *fit.late_s)
    if fit.is_too_late:
        late = [too_late_warning("Pictures", fit.late_s[0])]
    return latency_warning(fit.latency_steps) + late


def too_late_warning(what: str, late_s: float) -> str:
    """On a lateness at the end of its range."""
    return _TOO_LATE.format(what, 1e3 * abs(late_s), "late" if late_s > 0 else "early")


def bound_warnings(space: ParameterSpace, unit: np.ndarray, fitted: np.ndarray) -> dict[str, str]:
    """{name: warning} of parameters that ended at a bound beyond which the truth may lie.

    `unit`: (N,) in unit coordinates; `fitted`: (N,) bool. Nothing lies beyond a low bound of 0, or
    beyond the bounds of a colour.
    """
    at_bound = (unit < _AT_BOUND) & (space.low != 0) | (unit > 1 - _AT_BOUND)
    counts = at_bound & fitted & ~space.is_appearance
    return {
        name: f"{name} ended at a bound of its range: the truth may lie beyond, or the model lacks "
        "something; give it a wider low and high to see"
        for name, is_there in zip(space.names, counts, strict=True)
        if is_there
    }


def latency_warning(latency_steps: int) -> list[str]:
    """One if actions take effect late."""
    if not latency_steps:
        return []
    steps = "1 step" if latency_steps == 1 else f"{latency_steps} steps"
    return [
        f"The actions seem to take effect {steps} later than the recordings say; the "
        "estimates allow for it."
    ]


def lateness_warning(what: str, late_s: float, std: float) -> list[str]:
    """One if pictures or readings are clearly late; `std`: of `late_s`."""
    if abs(late_s) <= max(_CLEARLY_LATE_STDS * std, _CLEARLY_LATE_S):
        return []
    when = "later" if late_s > 0 else "sooner"
    return [
        f"The {what} seem to come {1e3 * abs(late_s):.0f} ms {when} than the recordings say "
        f"(± {1e3 * std:.1f} ms); the estimates allow for it."
    ]
