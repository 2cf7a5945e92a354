"""Which worlds of a replay are played at once, and for how many steps."""

from typing import NamedTuple

import numpy as np

# Of the full states of worlds played at once: those of an arm's whole episodes, with a world for
# every derivative, may need more memory than there is
_MOST_BYTES = 2**29
_MIN_SAVED_SHARE = 0.2  # of all steps, by shorter plays


class Part(NamedTuple):
    worlds: np.ndarray  # (n,) indices, ascending
    steps: int  # to be played


def parts_to_play(values: np.ndarray, num_groups: int, state_bytes: int) -> list[Part]:
    """Parts of `num_groups` times W worlds, which play W stretches in turn.

    `values`: (W, K + 1, D) readings of the stretches. Those of short episodes end long before K
    steps, and what comes after is compared with nothing.
    """
    num, found = len(values), list[Part]()
    for stretches, steps in _of_similar_length(values):
        worlds = (num * np.arange(num_groups)[:, None] + stretches).ravel()
        num_bytes = len(worlds) * (steps + 1) * state_bytes
        num_parts = min(max(1, -(-num_bytes // _MOST_BYTES)), max(1, len(worlds)))
        found += [Part(part, steps) for part in np.array_split(worlds, num_parts)]
    return found


def _of_similar_length(values: np.ndarray) -> list[tuple[np.ndarray, int]]:
    """Stretches, (n,) indices, whose readings end within a factor of two, and steps to play."""
    num, most = len(values), values.shape[1] - 1
    known = np.any(np.isfinite(values), axis=-1)
    last = np.where(np.any(known, axis=1), most - known[:, ::-1].argmax(1), 0)
    # One more, since a lateness is interpolated within the step after a reading
    ends = np.clip(last + 1, 1, max(1, most))
    shorter = np.log2(max(1, most) / ends).astype(int)
    groups = [np.flatnonzero(shorter == number) for number in np.unique(shorter)]
    steps = [most if not shorter[group[0]] else int(ends[group].max()) for group in groups]
    played = sum(len(group) * its for group, its in zip(groups, steps, strict=True))
    if played > (1 - _MIN_SAVED_SHARE) * num * most:
        return [(np.arange(num), most)]
    return list(zip(groups, steps, strict=True))
