"""What a fit and its replicas say: how sure it is, what hangs together, what to doubt."""

from dataclasses import replace

import numpy as np

from simtune.fit.bootstrap import Bootstrap
from simtune.fit.result import FitResult
from simtune.randomization import Distribution

_WORTH_TELLING = 0.6  # correlation
# Times as far off as the worst replica's: with few of them, the worst one is not very bad yet.
_DOUBTFUL, _DOUBTFUL_OF_ONE = 1.6, 1.8


def inflate(fit: FitResult, replicas: Bootstrap, looks_alike: bool) -> FitResult:
    """A fit with the standard deviations that replicas show, larger still where it fits worse.

    Unless the real world `looks_alike` to the simulator, allow for what no fit can see.
    """
    worse_motion = max(1.0, replicas.ratio(fit.misfit, "motion_px"))
    worse_picture = max(1.0, replicas.ratio(fit.misfit, "picture"))
    factor = replicas.inflation()
    std = fit.std * np.where(fit.is_moving, worse_motion, worse_picture)
    return replace(fit, std=factor * np.hypot(std, fit.discrepancy(looks_alike)))


def in_range(fit: FitResult, distribution: Distribution) -> tuple[np.ndarray, np.ndarray]:
    """(N,) means and standard deviations in coordinates of the range, -1 to 1."""
    space = distribution.space
    width = space.to_unit(distribution.high) - space.to_unit(distribution.low)
    return 2 * distribution.to_local(fit.parameters) - 1, 2 * fit.std / width


def correlations(fit: FitResult, names: tuple[str, ...]) -> dict[str, float]:
    """{"a, b": correlation} of the pairs that the motion can hardly tell from each other."""
    found = {}
    for i, j in zip(*np.triu_indices(len(fit.moving), 1), strict=True):
        value = float(fit.correlation[i, j])
        if abs(value) >= _WORTH_TELLING:
            found[f"{names[fit.moving[i]]}, {names[fit.moving[j]]}"] = round(value, 2)
    return found


def ranks(replicas: Bootstrap, names: tuple[str, ...]) -> dict[str, list[float]]:
    """{name: ranks of the replicas' truths}."""
    if not len(replicas.errors):
        return {}
    return dict(zip(names, replicas.ranks().T.round(4).tolist(), strict=True))


def doubts(fit: FitResult, replicas: Bootstrap) -> list[str]:
    """What to tell a user who would trust the estimates."""
    given = []
    limit = _DOUBTFUL + _DOUBTFUL_OF_ONE / max(1, len(replicas.misfits))
    if (ratio := replicas.ratio(fit.misfit, "motion_px")) > limit:
        found = (
            f"keypoints are {fit.misfit.motion_px:.2f} px off, {ratio:.1f} times as far as"
            if np.isfinite(ratio)
            else "nothing that moves is found for sure, as it is"
        )
        given.append(
            "No setting of the parameters makes the simulator move as the videos do: where that "
            f"was tested {found} in worlds that the simulator can make. Something that "
            "is not tuned is wrong (a length, a mass, the camera, a delay): trust no number "
            "before it is found."
        )
    if fit.lag:
        steps = "1 step" if fit.lag == 1 else f"{fit.lag} steps"
        given.append(
            f"The actions seem to take effect {steps} later than the recordings say; the "
            "estimates allow for it."
        )
    return given
