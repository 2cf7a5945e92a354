"""Whether the robot is where simulated worlds are that replay the same actions.

A policy that watches a robot keeps it on its legs; worlds that replay its actions fall. What was
learnt from them, and known worlds, then are about other poses than the videos show.

How far an episode x is from the worlds at a step, in pixels, and how strange it is:

    d(x) = √(δ² + ε²),  δ: median over keypoints of the distance to the third nearest world
    s(x) = mean over steps of log d(x) / median of the worlds' d

A world's own s leaves out the world itself, and the detector's errors are added to it.
"""

from dataclasses import replace

import numpy as np

from simtune.tuning.estimate import Estimate, at_most_weak
from simtune.tuning.fit_stage import Detected, HeldOut

_NEAREST = 3  # so that no single world decides
_COMPARED = 200  # episodes of worlds, at most
_STEPS = 40  # that are compared
# ε, of the pictures' height. In a narrow range worlds hardly differ, and real detections are a
# little off in ways of their own: a pixel of 64 must not count as strange.
_TOLERANCE = 1 / 20
# Real episodes are strange if s exceeds this quantile of the worlds' by this margin. Two sets of a
# walking walker have .49 and .40, their worlds' quantiles .36 and .31; four sets of random actions
# and one of a cheetah's policy have −.03 to .05, the quantiles .17 to .61.
_QUANTILE, _MARGIN = 0.99, 0.05

STRANGE = (
    "The robot is often where no simulated world gets by the same actions. That happens where a "
    "policy that watches the robot chose the actions: replayed, they keep no simulated robot on "
    "its legs. Networks and known worlds then know other poses than the videos show, so no number "
    "is called identified. Record with actions that do not depend on what the robot does (random "
    "ones, a script). If they did not, episodes begin elsewhere than the simulator's (see "
    "initial_state in docs/tuning-file.md), or something else in it is wrong."
)


def doubted(estimate: Estimate) -> Estimate:
    """An estimate from strange videos: nothing is identified, and why."""
    warnings = [*estimate.warnings, STRANGE]
    return replace(estimate, verdict=at_most_weak(estimate.verdict), warnings=warnings)


def are_strange(worlds: np.ndarray, held_out: HeldOut, detected: Detected) -> bool:
    """Whether real episodes are stranger than nearly all worlds; not if nothing visible moves.

    `worlds`: (W, E, T + 1, L, 2) true keypoints, pixels.
    """
    real = [found.keypoints for found in detected.detections]
    num_steps = min(worlds.shape[2], *map(len, real))
    if not worlds.shape[3]:
        return False
    at = np.unique(np.linspace(0, num_steps - 1, _STEPS).astype(int))
    compared = worlds[:, : max(1, _COMPARED // len(worlds)), at]
    num, each, *rest = compared.shape
    true = compared.reshape(num * each, *rest)
    errors = _errors(held_out)
    drawn = np.random.default_rng(0).integers(len(errors), size=true.shape[:2])
    world = np.arange(len(true)) // each
    tolerance = _TOLERANCE * held_out.worlds.frames.shape[2]
    usual = _distances(true + errors[drawn], true, world[:, None] != world, tolerance)
    found = _distances(np.stack([its[at] for its in real]), true, None, tolerance)
    median = np.median(usual, 0)
    of_worlds = np.log(usual / median).reshape(num, -1).mean(1)
    return bool(np.log(found / median).mean() > np.quantile(of_worlds, _QUANTILE) + _MARGIN)


def _errors(held_out: HeldOut) -> np.ndarray:
    """(n, L, 2) pixels by which the detector was off in single pictures."""
    true = held_out.worlds.filmed_keypoints()
    return held_out.detections.keypoints - true.reshape(-1, *true.shape[2:])


def _distances(
    some: np.ndarray, worlds: np.ndarray, others: np.ndarray | None, tolerance: float
) -> np.ndarray:
    """(m, T) d of (m, T, L, 2) episodes from (n, T, L, 2) worlds; `others`: (m, n), which count."""
    found = np.empty(some.shape[:2])
    for t in range(some.shape[1]):
        apart = np.linalg.norm(some[:, None, t] - worlds[None, :, t], axis=-1)
        median = np.median(apart, -1)
        if others is not None:
            median = np.where(others, median, np.inf)
        found[:, t] = np.partition(median, _NEAREST - 1, 1)[:, _NEAREST - 1]
    return np.hypot(found, tolerance)
