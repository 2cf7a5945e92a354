"""Episodes whose end cannot be told from their beginning: after a contact, or a fall."""

from collections.abc import Sequence

import numpy as np

from simtune.checking.replayed_contacts import Touching, in_words
from simtune.columns import cut
from simtune.fit.readings.growth import MUCH

_MOST_NAMED = 5


def growth_warnings(
    growth: np.ndarray, names: Sequence[str], found: Sequence[Touching] | None = None
) -> list[str]:
    """On episodes with these names; `growth`: (E,) as in `ReadingChanges`, of the first ones.

    `found`: what touches in replays of the sensitive ones, None if that is not known.
    """
    much = [names[episode] for episode in sensitive(growth)]
    if not much:
        return []
    some = f"{len(much)} of {len(growth)} episodes replayed ({cut(much, _MOST_NAMED)})"
    contact = "" if found is not None and not found else "a contact, "
    said = (
        f"in {some} an error of a first reading grows up to {np.nanmax(growth):,.0f} times "
        f"({contact}a fall, what swings freely, such as a load on a cable, or what only a "
        "controller holds up, such as a robot that balances or an arm that torques move: it is "
        "unstable open loop): no replay from their beginning ends as they do. A fit to readings "
        "follows such an episode in parts, each from readings of its own."
    )
    return [said + (f" In these replays {in_words(found, much)}" if found else "")]


def sensitive(growth: np.ndarray) -> list[int]:
    """Indices of the episodes of (E,) growth in which errors grow much."""
    return np.flatnonzero(growth > MUCH).tolist()
