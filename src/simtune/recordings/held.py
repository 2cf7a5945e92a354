"""Actions of a table with empty cells: each is held until the next one of its column.

Cells are empty where a log merges several clocks and only another one ticked, or where it has
changes alone.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simtune.recordings.resample import is_regular
from simtune.recordings.source import Rows


def hold_actions(rows: Rows, columns: Sequence[int]) -> Rows:
    """An episode with these columns of actions, which begins where all of them are known.

    Before, readings alone count, and actions are the first ones. A column without any number stays
    as it is.
    """
    actions = rows.actions[:, columns]
    if rows.is_empty is None or not (is_empty := rows.is_empty[:, columns]).any():
        return replace(rows, actions=actions)
    firsts = (~is_empty).argmax(0)
    last = np.where(is_empty, firsts, np.arange(len(rows))[:, None])
    actions = np.take_along_axis(actions, np.maximum.accumulate(last), 0)
    is_begun = begins(rows.times_s, ~is_empty)
    is_begun[: firsts.max()] = False
    return replace(rows, actions=actions, is_begun=is_begun)


def begins(times_s: np.ndarray, is_given: np.ndarray) -> np.ndarray:
    """(T,) bool, at which of (T,) times actions begin, of which (T, A) bool say which are given.

    Where any is, if those come at a rate of their own; else in all rows, which have a rate then.
    """
    is_any: np.ndarray = np.any(is_given, axis=1)
    return is_any if is_regular(times_s[is_any]) else np.ones(len(times_s), bool)
