"""Whether a fit explains the videos as well as refits explain those of known worlds."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from simtune.columns import two_digits
from simtune.fit.calibration.refits import Refits
from simtune.fit.motion.common_errors import Beside
from simtune.fit.result import FitResult

# Ratio to the worst refit's misfit; with few refits their worst is not very large yet.
_DOUBTFUL_RATIO, _FEW_REFITS_EXTRA = 1.6, 1.8
_GO_ON = "Give it more minutes: the same command with a larger budget goes on from here."
_HARDLY_JUDGED = (
    "A single known world was fitted for comparison, so intervals lean on how far fits usually "
    f"are off. {_GO_ON}"
)
_NOT_JUDGED = (
    "There was no time to fit a known world for comparison, so nothing tells how far what videos "
    f"say can be trusted: none of it is called identified. {_GO_ON}"
)
_DIVERGED = (
    "All known worlds that were to be fitted for comparison diverged, so nothing tells how far "
    "what videos say can be trusted: none of it is called identified. A smaller physics timestep, "
    "or narrower bounds, may help."
)
_NOTHING_FOUND = (
    "In the known worlds fitted for comparison nothing that moves is found for sure, so how well "
    "the simulator moves as the videos do cannot be tested: none of it is called identified. Film "
    "what moves larger."
)
_SEEN_ELSEWHERE = (
    "What shows {} is not where the fit has it, or looks otherwise than any simulated camera shows "
    "it: there, pixels are {:.0f} of 255 levels off, {:.0f} times as far as in worlds that the "
    "simulator can make. So these, and what pictures tell of the motion, are at most weak. A run "
    "with more minutes or more episodes may find it."
)

_NO_CAMERA = (
    "With the known colour as declared, the camera would have a gamma of {:.2f} and an offset of "
    "{:.0f} of 255 levels, which cameras hardly have: its thing seems to be lit, or to shine, "
    "otherwise than the model says. So colours are at most weak. Declare a matter one as known, in "
    "the same light as the others, or none."
)

_BESIDE_STDS = 2.5  # a camera that is right has 1, one 2 px off had 4
_ONE_WAY_SHARE = 0.5  # of that distance: with less in the mean, no camera stands aside
_SEEN_BESIDE = (
    "What moves is seen {:.1f} px beside where it is simulated, in all pictures alike (in the mean "
    "{:.1f} px {} and {:.1f} px {}). So does a camera that stands, looks or zooms otherwise than "
    "the model's, or a part of another shape. Estimates allow for it, but are surer without: "
    "declare what may be wrong (kinds camera_pose, field_of_view, size)."
)
_MISSHAPEN = (
    "What moves is seen {:.1f} px beside where it is simulated, in all pictures alike, and its "
    "parts to different sides. So is a part of another length or shape, or all before a camera "
    "that zooms otherwise. What moves makes up for it, so none of that is called identified. Mend "
    "the model, or declare what may be wrong (kinds size, field_of_view, camera_pose; field = "
    '"body_pos").'
)


# What may be wrong where no setting explains a motion: what cameras show, or the model
Unexplained = Literal["nothing", "film", "model"]
_OF_FILMS = "px"  # unit of what cameras see


def has_comparison(refits: Refits) -> bool:
    """Whether known worlds show how far off the motion of a right simulator is."""
    return any(np.isfinite(known.motion).any() for known in refits.misfits)


def is_motion_unexplained(fit: FitResult, refits: Refits) -> bool:
    """Whether the motion misfit is far larger than in refits, where the simulator is right."""
    return bool(_unexplained_units(fit, refits))


def what_is_unexplained(fit: FitResult, refits: Refits) -> Unexplained:
    """Where what no setting explains may lie.

    In the film alone if readings are explained, and nothing says that parts are of another length.
    """
    units = _unexplained_units(fit, refits)
    if not units:
        return "nothing"
    return "film" if units == {_OF_FILMS} and not is_misshapen(fit) else "model"


def lacks_known_worlds(refits: Refits) -> bool:
    """Whether time ended before more than one could be fitted: with more of it, others are."""
    num = len(refits.misfits)
    return num == 1 or not (num or refits.num_diverged)


def _unexplained_units(fit: FitResult, refits: Refits) -> set[str]:
    """Units of the sensors whose misfit is far larger than in refits."""
    if not refits.misfits:
        return set()
    limit = _DOUBTFUL_RATIO + _FEW_REFITS_EXTRA / len(refits.misfits)
    ratios = refits.motion_ratios(fit.misfit)
    return {unit for (_, unit), ratio in zip(fit.sensors, ratios, strict=True) if ratio > limit}


def model_checks(fit: FitResult, refits: Refits) -> list[str]:
    """Warnings for users who rely on the estimates."""
    return _of_motion(fit, refits) + _beside(fit) + _of_camera(fit)


def is_misshapen(fit: FitResult) -> bool:
    """Whether parts are seen beside where they are simulated, to different sides."""
    its = _farthest_beside(fit)
    return its is not None and np.hypot(its.right, its.down) < _ONE_WAY_SHARE * its.px


def _farthest_beside(fit: FitResult) -> Beside | None:
    """Of the camera whose pictures are farthest beside, if farther than known worlds' are."""
    far = [its for its in fit.beside if its.stds > _BESIDE_STDS]
    return max(far, key=lambda its: its.stds, default=None)


def _beside(fit: FitResult) -> list[str]:
    """One if pictures are all alike beside the simulation."""
    if (its := _farthest_beside(fit)) is None:
        return []
    if is_misshapen(fit):
        return [_MISSHAPEN.format(its.px)]
    across = abs(its.right), "right" if its.right > 0 else "left"
    along = abs(its.down), "down" if its.down > 0 else "up"
    return [_SEEN_BESIDE.format(its.px, *across, *along)]


def _of_camera(fit: FitResult) -> list[str]:
    """One if known colours make a response that is no camera's."""
    its = fit.unusual_camera
    return [_NO_CAMERA.format(its.gamma, 255 * its.offset)] if its else []


def _of_motion(fit: FitResult, refits: Refits) -> list[str]:
    """Whether known worlds' fits explain as much, or could not tell."""
    if not refits.misfits:
        return [_DIVERGED if refits.num_diverged else _NOT_JUDGED]
    if not has_comparison(refits):
        return [_NOTHING_FOUND]
    warnings, num = [], len(refits.misfits)
    if num == 1:
        warnings.append(_HARDLY_JUDGED)
    if is_motion_unexplained(fit, refits):
        ratios = refits.motion_ratios(fit.misfit)
        ratio, worst = max(ratios), int(np.argmax(ratios))
        (name, unit), distance = fit.sensors[worst], fit.misfit.motion[worst]
        found = (
            f"they are {two_digits(distance)} {unit} apart ({name}), {ratio:.1f} times as far as"
            if np.isfinite(ratio)
            else "nothing that moves is found for sure, as it is"
        )
        warnings.append(
            "No setting of the parameters makes the simulator move as recorded: where that "
            f"was tested, {found} in worlds that the simulator can make. Something that "
            "is not tuned is wrong (a length, a mass, the camera, a delay, which action moves what "
            "and in which direction): trust no number "
            "before it is found."
        )
    return warnings


def elsewhere_warning(fit: FitResult, refits: Refits, visible: Sequence[str]) -> list[str]:
    """If pixels that show `visible` parameters are of something else; see `is_elsewhere`."""
    which = np.flatnonzero(refits.is_elsewhere(fit.misfit))
    if not which.size:
        return []
    ratios, noise = refits.picture_ratios(fit.misfit)[which], np.array(fit.misfit.picture)[which]
    worst, names = int(ratios.argmax()), ", ".join(np.array(visible)[which])
    return [_SEEN_ELSEWHERE.format(names, 255 * noise[worst], ratios[worst])]


def held_out_misfit(fit: FitResult, refits: Refits) -> dict[str, Any]:
    """How well the fit explains the held-out episode; JSON.

    "episode" counts from 1; None: too few episodes. "passed": by `is_motion_unexplained`; None:
    nothing to compare with. Each sensor's "distance" is the fit's, next to those of known worlds.
    """
    known = [misfit.motion for misfit in refits.misfits]
    passed = not is_motion_unexplained(fit, refits) if has_comparison(refits) else None
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
