"""Names by which users choose, in commands and below; and what holds for each search."""

from dataclasses import dataclass, replace
from typing import Literal

RendererName = Literal["raycaster", "opengl"]
ExportFormat = Literal["samples", "mjlab", "playground"]
AgentName = Literal["teacher_student", "curl_sac"]
SearchName = Literal["posterior", "paper", "regression"]
DEFAULT_SEARCH: SearchName = "posterior"


@dataclass(frozen=True, kw_only=True)
class SearchTraits:
    """What holds for a search, wherever that makes a difference outside of it."""

    has_intervals: bool  # low and high are the ends of 90 % intervals, not of the searched range
    estimates_delay: bool  # by how much actions come late
    cuts_to_shortest: bool  # all episodes are as long as the shortest
    takes_readings: bool  # of joints, also without any camera
    takes_known_colours: bool
    takes_small_steps: bool  # in many rounds; with --window, --range-spm and --step-size
    needs_square_pictures: bool  # of one camera, and as high as usual, whatever they show
    usual_px: int  # height of its pictures
    in_words: str  # after "was tuned", in a report


_PAPER = SearchTraits(
    has_intervals=False,
    estimates_delay=False,
    cuts_to_shortest=False,
    takes_readings=False,
    takes_known_colours=False,
    takes_small_steps=True,
    needs_square_pictures=True,
    usual_px=100,
    in_words="by the paper's steps up or down",
)
SEARCHES: dict[SearchName, SearchTraits] = {
    "posterior": SearchTraits(
        has_intervals=True,
        estimates_delay=True,
        cuts_to_shortest=True,
        takes_readings=True,
        takes_known_colours=True,
        takes_small_steps=False,
        needs_square_pictures=False,
        usual_px=64,
        in_words="",
    ),
    "paper": _PAPER,
    "regression": replace(_PAPER, in_words="by the paper's baseline"),
}
_NONE = replace(_PAPER, takes_small_steps=False, needs_square_pictures=False, in_words="")


def search_traits(name: str | None) -> SearchTraits:
    """A search's; nothing holds for None, and for a name that this version does not know."""
    return next((its for search, its in SEARCHES.items() if search == name), _NONE)


def searches_where(trait: str) -> str:
    """The option that chooses a search with this trait, for messages: --search paper or ..."""
    return f"--search {' or '.join(n for n, its in SEARCHES.items() if getattr(its, trait))}"
