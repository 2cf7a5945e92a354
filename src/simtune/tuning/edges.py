"""Doubts about what a round finds at or beyond an edge of the range that it searched."""

from dataclasses import replace

import numpy as np

from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate
from simtune.tuning.search import Event
from simtune.tuning.survival_curves import candidate_grid
from simtune.verdicts import at_most_weak

_AT_EDGE = (
    "The truth may lie beyond the range that was searched of {}, which no fit can follow here, so "
    "that is not called identified. Another round searches beyond: give it more minutes."
)
_OUT_OF_REACH = (
    "{} ended beyond {:.3g}, the edge of what the last round could reach: the truth may lie "
    "anywhere up to the bound of {:.3g}, or the model lacks something, so it is at most weak"
)


def out_of_reach(prob_higher: np.ndarray, distribution: Distribution) -> np.ndarray:
    """(N,) −1 or 1 where a curve's median is beyond that end of the grid; 0 elsewhere.

    Also 0 where the parameter's bound is no farther away than the grid's end.
    """
    space, grid = distribution.space, candidate_grid()
    is_below = (prob_higher[:, 0] < 0.5) & (distribution.to_range_unit(space.low) < grid[0])
    is_above = (prob_higher.min(1) > 0.5) & (distribution.to_range_unit(space.high) > grid[-1])
    return is_above.astype(int) - is_below


def followed(estimate: Estimate, side: np.ndarray, fitted: np.ndarray) -> Estimate:
    """The estimate, with a fit's (N,) parameters where they are out of reach on a `side`, (N,).

    `read_curves` has the grid's end there. Curves go on to the fit's value, so that draws have the
    same median.
    """
    mean, curves, names = estimate.mean.copy(), dict(estimate.curves), list(estimate.curves)
    for i in np.flatnonzero(side).tolist():
        mean[i] = (min if side[i] < 0 else max)(mean[i], fitted[i])
        candidates, prob_higher = curves[names[i]]
        at = 0 if side[i] < 0 else len(candidates)
        curves[names[i]] = np.insert(candidates, at, mean[i]), np.insert(prob_higher, at, 0.5)
    return replace(estimate, mean=mean, curves=curves)


def reach_warnings(space: ParameterSpace, side: np.ndarray, edge: np.ndarray) -> dict[str, str]:
    """{name: warning} of parameters beyond the (N,) `edge` of what a round reaches, on a `side`."""
    bound = np.where(side < 0, space.low, space.high)
    return {
        space.names[i]: _OUT_OF_REACH.format(space.names[i], edge[i], bound[i])
        for i in np.flatnonzero(side)
    }


def doubted_at_edges(estimate: Estimate, events: list[Event]) -> Estimate:
    """The estimate; parameters at an edge of the searched range are at most weak, with a warning.

    Networks say little of what lies beyond the range that they were trained in.
    """
    widened = _widened(events)
    if not widened:
        return estimate
    return replace(
        estimate,
        verdict=at_most_weak(
            estimate.verdict, np.array([name in widened for name in estimate.curves])
        ),
        warnings=[*estimate.warnings, _AT_EDGE.format(", ".join(widened))],
    )


def leads_beyond(
    prob_higher: np.ndarray, distribution: Distribution, events: list[Event], is_fitted: bool
) -> bool:
    """Whether intervals say nothing yet, as the next round searches beyond what this one reached.

    A fit follows to the ends of the grid, networks only to those of the range.
    """
    side = out_of_reach(prob_higher, distribution)
    sides = dict(zip(distribution.space.names, side, strict=True))
    return any(sides[name] or not is_fitted for name in _widened(events))


def _widened(events: list[Event]) -> list[str]:
    return [event.parameter for event in events if event.event == "widened"]
