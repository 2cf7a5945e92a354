"""How Ξ is moved towards the real world: the searches, by name."""

import numpy as np

from simtune.config import SearchName
from simtune.errors import InputError
from simtune.progress import Say
from simtune.search_param_model.paper import PaperConfig
from simtune.simulation import AnySimulator, Simulator
from simtune.tuning.fixed import FixedRange
from simtune.tuning.paper import PaperSearch
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import Search

_IMAGE_SIZES = {"posterior": 64, "paper": 100, "regression": 100}  # pixels a side


def needed_image_size(search: SearchName) -> int:
    """Pixels a side of the square pictures that a search looks at."""
    return _IMAGE_SIZES[search]


def make_search(
    search: SearchName,
    simulator: AnySimulator,
    camera: str,
    start: np.ndarray,
    seed: int,
    say: Say,
    looks_alike: bool,
    config: PosteriorSearchConfig | PaperConfig | None = None,
    device: str = "cpu",
) -> Search:
    """A search that begins at the (N,) parameters `start`, and says what it does.

    `looks_alike`: the real world is drawn as `simulator` draws, and moves as promptly. `config` is
    the search's own kind; `device` is that of the paper's networks. Raises InputError for an
    environment that is searched by windows, whose frames are drawn anew on resumption.
    """
    if search == "posterior":
        assert not isinstance(config, PaperConfig)
        return PosteriorSearch(
            simulator, camera, start, config, seed=seed, say=say, looks_alike=looks_alike
        )
    assert not isinstance(config, PosteriorSearchConfig)
    if not isinstance(simulator, Simulator):
        raise InputError(f"--search {search} needs a MuJoCo model; --search posterior does not")
    settings = {"seed": seed, "say": say, "device": device}
    return PaperSearch(simulator, start, config, method=search, **settings)


__all__ = ["FixedRange", "make_search", "needed_image_size"]
