"""Episodes whose end cannot be told from their beginning: after a contact, or a fall."""

from collections.abc import Sequence

import numpy as np

from simtune.columns import cut

# Errors of a position that grow so many times: in servos and pendulums they grow 1 to 5 times, in
# episodes of robots that strike something or fall 150 to 50,000 times
_MUCH = 30.0
_MOST_NAMED = 5


def warnings(growth: np.ndarray, names: Sequence[str]) -> list[str]:
    """On episodes with these names; `growth`: (E,) as in `ReadingChanges`, of the first ones."""
    much = [names[episode] for episode in np.flatnonzero(growth > _MUCH).tolist()]
    if not much:
        return []
    some = f"{len(much)} of {len(growth)} episodes replayed ({cut(much, _MOST_NAMED)})"
    advice = " Leave them out (--leave-out), or end them before." * (len(much) < len(growth))
    return [
        f"in {some} an error of a first reading grows up to {np.nanmax(growth):,.0f} times (a "
        "contact, a fall?): how they end cannot be told from how they begin, and a fit to them "
        f"knows less than is said here.{advice}"
    ]
