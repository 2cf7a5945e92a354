"""How Ξ is moved towards the real world: the searches, by name."""

import numpy as np

from simtune.config import SearchName
from simtune.progress import Say
from simtune.simulation import Simulator
from simtune.tuning.fixed import FixedRange
from simtune.tuning.paper import PaperSearch
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.search import Search

_IMAGE_SIZES = {"posterior": 64, "paper": 100, "regression": 100}  # pixels a side


def needed_image_size(search: SearchName) -> int:
    """Pixels a side of the square pictures that a search looks at."""
    return _IMAGE_SIZES[search]


def make_search(
    search: SearchName,
    simulator: Simulator,
    camera: str,
    start: np.ndarray,
    seed: int,
    say: Say,
    looks_alike: bool,
) -> Search:
    """A search that begins at the (N,) parameters `start`, and says what it does.

    `looks_alike`: the real world is drawn as `simulator` draws, and moves as promptly.
    """
    if search == "posterior":
        return PosteriorSearch(
            simulator, camera, start, seed=seed, say=say, looks_alike=looks_alike
        )
    return PaperSearch(simulator, start, seed=seed, method=search, replay_actions=True, say=say)


__all__ = ["FixedRange", "PaperSearch", "PosteriorSearch", "make_search", "needed_image_size"]
