"""Which episodes are fitted, and which one tests the fit."""

from typing import NamedTuple

_FEWEST_TO_FIT = 2


class Split(NamedTuple):
    """All episodes but the last are fitted, if these are two or more; the last is a test."""

    fitted: slice
    tested: slice  # the one held out; all, if there is none
    held_out: int | None  # its index

    @classmethod
    def of(cls, num_episodes: int) -> "Split":
        if num_episodes <= _FEWEST_TO_FIT:
            return cls(slice(num_episodes), slice(num_episodes), None)
        last = num_episodes - 1
        return cls(slice(last), slice(last, num_episodes), last)

    @property
    def num_fitted(self) -> int:
        """Number of fitted episodes."""
        return self.fitted.stop
