"""Episodes whose end cannot be told from their beginning: after a contact, or a fall."""

from collections.abc import Sequence

import numpy as np

from simtune.columns import cut
from simtune.fit.readings.growth import MUCH

_MOST_NAMED = 5


def warnings(growth: np.ndarray, names: Sequence[str]) -> list[str]:
    """On episodes with these names; `growth`: (E,) as in `ReadingChanges`, of the first ones."""
    much = [names[episode] for episode in np.flatnonzero(growth > MUCH).tolist()]
    if not much:
        return []
    some = f"{len(much)} of {len(growth)} episodes replayed ({cut(much, _MOST_NAMED)})"
    return [
        f"in {some} an error of a first reading grows up to {np.nanmax(growth):,.0f} times (a "
        "contact, a fall?): no replay from their beginning ends as they do. A fit to readings "
        "follows such an episode in parts, each from readings of its own."
    ]
