"""A search by its name."""

from simtune.names import SearchName
from simtune.search_param_model.paper import PaperConfig
from simtune.tuning.paper import PaperSearch
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import Search, SearchContext

SearchSettings = PosteriorSearchConfig | PaperConfig


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
