"""What the posterior search can work with, and which parameters it must know precisely."""

from collections.abc import Sequence

import numpy as np

from simtune.columns import episode_in_words
from simtune.errors import InputError
from simtune.search_param_model.posterior_net import SHORTEST_STEPS
from simtune.trajectory import Trajectory
from simtune.tuning.search import SearchContext


def refuse_what_never_shows(context: SearchContext) -> None:
    """Raises InputError if nothing moves that could show a hidden parameter."""
    hidden = [p.name for p in context.simulator.space if not p.is_visible]
    if hidden and not len(context.keypoints):
        raise InputError(
            f"{hidden[0]} shows in motion only, and nothing moves in the simulator's episodes: "
            "have them start elsewhere, act, or leave the parameter out"
        )


def refuse_short(real: Sequence[Trajectory], names: Sequence[str]) -> None:
    """Raises InputError if there are no trajectories, or too short ones; see `Search.check`."""
    if not real:
        raise InputError("no episodes: there is nothing to tune to")
    lengths = [len(t) for t in real]
    if (steps := min(lengths)) < SHORTEST_STEPS:
        episode = episode_in_words(names, lengths.index(steps))
        raise InputError(
            f"{episode} has {steps} steps; expected at least {SHORTEST_STEPS}: leave it out "
            "(--leave-out), or record a longer one"
        )


def what_counts(context: SearchContext, tolerates_brightness: bool) -> tuple[np.ndarray, str]:
    """Indices of the parameters that must be precise, and what to call each of them.

    `tolerates_brightness`: see `PosteriorSearchConfig`.
    """
    space = context.simulator.space
    moving = np.flatnonzero(~space.is_appearance)
    is_dimmed = tolerates_brightness and context.observation.image_noise is not None
    if is_dimmed and len(moving):
        return moving, "parameter of the motion"
    return np.arange(len(space)), "parameter"
