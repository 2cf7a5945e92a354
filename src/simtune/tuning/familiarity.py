"""Whether the robot is where simulated worlds are that replay the same actions.

A feedback controller keeps a robot on its legs; worlds that replay its actions fall. What was
learnt from them, and known worlds, then are about other poses than the videos show.

How far an episode x is from the worlds at a step, in pixels, and how strange it is:

    d(x) = median over keypoints of the distance to the third nearest world
    s(x) = mean over steps of the share of worlds with a smaller d

A world's own d leaves out the world itself, and the detector's errors are added to it.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.tuning.estimate import Estimate
from simtune.tuning.learning import Detected, HeldOut
from simtune.verdicts import at_most_weak

_NEAREST_RANK = 3  # so that no single world decides
_MAX_COMPARED_EPISODES = 400  # of worlds
_COMPARED_STEPS = 25
# Real episodes are strange if s exceeds a quantile of the worlds' s: the higher one, or the lower
# one if the held-out episode is explained worse than known worlds, too.
_STRANGE_QUANTILES = 0.99, 0.95
# And only if d exceeds the worlds' by so much of the pictures' height: in a narrow range worlds
# hardly differ, and real detections are a little off in ways of their own.
_FAR_HEIGHT_SHARE = 1 / 32
_WORSE_RATIO = 1.3  # to the distance of the worst known world

STRANGE = (
    "The robot is often where no simulated world gets by the same actions. That happens where a "
    "feedback controller chose the actions (a policy that watches the robot, a firmware's PD, a "
    "teleoperator who corrects): replayed, they keep no simulated robot on its legs, and no arm "
    "up. Networks and known worlds then know other poses than the videos show, so no number is "
    "called identified. Record with actions that do not depend on what the robot does (random "
    "ones, a script), or targets instead of a PD's torques; where the loop has to be closed, also "
    "record joint readings ([[sensors]]). If nothing corrected the actions, episodes begin "
    "elsewhere than the simulator's (see "
    "initial_state in docs/tuning-file.md), or something else in it is wrong."
)


class Strangeness(NamedTuple):
    """Whether real episodes are stranger than nearly all worlds, or than most."""

    clearly: bool
    perhaps: bool


NOT_STRANGE = Strangeness(False, False)


def doubted(estimate: Estimate, strangeness: Strangeness) -> Estimate:
    """The estimate; if its videos are strange, nothing is identified, and why."""
    is_strange = strangeness.clearly or (strangeness.perhaps and _is_worse(estimate))
    if not is_strange or STRANGE in estimate.warnings:
        return estimate
    warnings = [*estimate.warnings, STRANGE]
    return replace(estimate, verdict=at_most_weak(estimate.verdict), warnings=warnings)


def _is_worse(estimate: Estimate) -> bool:
    """Whether keypoints of the held-out episode are explained worse than in known worlds."""
    off = estimate.held_out.get("sensors", {}).get("keypoints", {})
    known = [distance for distance in off.get("known_worlds", []) if distance is not None]
    return bool(known) and (off["distance"] or 0.0) > _WORSE_RATIO * max(known)


def measure_strangeness(worlds: np.ndarray, held_out: HeldOut, detected: Detected) -> Strangeness:
    """How strange real episodes are among worlds; not at all if nothing visible moves.

    `worlds`: (W, E, T + 1, L, 2) true keypoints, pixels.
    """
    real = [found.keypoints for found in detected.detections]
    num_steps = min(worlds.shape[2], *map(len, real))
    if not worlds.shape[3]:
        return NOT_STRANGE
    at = np.unique(np.linspace(0, num_steps - 1, _COMPARED_STEPS).astype(int))
    compared = worlds[:, : max(1, _MAX_COMPARED_EPISODES // len(worlds)), at]
    num, each, *rest = compared.shape
    true = compared.reshape(num * each, *rest)
    errors = held_out.worlds.keypoint_errors(held_out.detections.keypoints).reshape(-1, *rest[1:])
    drawn = np.random.default_rng(0).integers(len(errors), size=true.shape[:2])
    world = np.arange(len(true)) // each
    usual = _distances(true + errors[drawn], true, world[:, None] != world)
    found = _distances(np.stack([its[at] for its in real]), true)
    if (found.mean(0) - usual.mean(0)).mean() < _FAR_HEIGHT_SHARE * held_out.worlds.frames.shape[2]:
        return NOT_STRANGE
    of_worlds = _shares(usual, usual).reshape(num, -1).mean(1)
    clearly, perhaps = _shares(found, usual).mean() > np.quantile(of_worlds, _STRANGE_QUANTILES)
    return Strangeness(bool(clearly), bool(perhaps))


def _shares(some: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """(m, T) of (m, T) distances: the share of (n, T) usual ones that are smaller at that step."""
    return (usual[None] < some[:, None]).mean(1)


def _distances(
    some: np.ndarray, worlds: np.ndarray, others: np.ndarray | None = None
) -> np.ndarray:
    """(m, T) d of (m, T, L, 2) episodes from (n, T, L, 2) worlds; `others`: (m, n), which count."""
    found = np.empty(some.shape[:2])
    for t in range(some.shape[1]):
        apart = np.median(np.linalg.norm(some[:, None, t] - worlds[None, :, t], axis=-1), -1)
        if others is not None:
            apart = np.where(others, apart, np.inf)
        found[:, t] = np.partition(apart, _NEAREST_RANK - 1, 1)[:, _NEAREST_RANK - 1]
    return found
