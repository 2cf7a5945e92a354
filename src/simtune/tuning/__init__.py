"""Searches, by name: how Ξ is moved towards the real world."""

from simtune.names import SearchName
from simtune.search_param_model.paper import PaperConfig
from simtune.tuning.fixed import FixedRange
from simtune.tuning.paper import PaperSearch
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import Search, SearchContext

SearchSettings = PosteriorSearchConfig | PaperConfig
_IMAGE_SIZES: dict[SearchName, int] = {"posterior": 64, "paper": 100, "regression": 100}


def usual_image_size(search: SearchName) -> int:
    """Side in pixels of the square pictures that a search uses."""
    return _IMAGE_SIZES[search]


def make_search(
    search: SearchName, context: SearchContext, settings: SearchSettings | None = None
) -> Search:
    """A search that starts at `context.start`; `settings` must be of its own kind.

    Raises InputError for an environment with a window-based search, whose frames are drawn anew
    when a run resumes, and if nothing moves that could show a hidden parameter.
    """
    if search == "posterior":
        assert not isinstance(settings, PaperConfig)
        return PosteriorSearch(context, settings)
    assert not isinstance(settings, PosteriorSearchConfig)
    return PaperSearch(context, settings, method=search)


__all__ = [
    "FixedRange",
    "SearchContext",
    "SearchSettings",
    "make_search",
    "usual_image_size",
]
