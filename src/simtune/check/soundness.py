"""Are recordings sound, all of them?"""

import numpy as np

from simtune.errors import InputError
from simtune.progress import ReportProgress
from simtune.recordings import Dataset

_MOST_NAMED = 5


def look_through(dataset: Dataset, say: ReportProgress) -> list[np.ndarray]:
    """Actions (T, A) of all episodes, each of whose frames was looked at and none kept.

    Raises InputError, after the last episode, where one is unsound; which others are is said too.
    """
    actions, faults = [], {}
    for episode, name in enumerate(dataset.episodes):
        say("reading the recordings", episode / len(dataset.episodes))
        try:
            actions.append(dataset.skim(episode))
        except InputError as error:
            faults[name] = str(error)
    if faults:
        first, *others = faults
        more = ", ".join(others[:_MOST_NAMED]) + ", ..." * (len(others) > _MOST_NAMED)
        also = f"; {len(others)} more of {dataset.num_episodes} are unsound: {more}"
        raise InputError(faults[first] + also * bool(others))
    return actions
