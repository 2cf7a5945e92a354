"""Colours that hide a plate: those of geoms that stand still, if they are parameters."""

from collections.abc import Mapping

import numpy as np

from simtune.cameras.views import apart
from simtune.simulation import Simulator
from simtune.simulation.rendering.plate import before_plate, geoms_coloured_by, stands_still

_NUM_STATES = 8  # looked at
_MIN_PICTURES_SHARE = 0.5


def painted_over(simulator: Simulator, states: np.ndarray, view: int) -> dict[str, float]:
    """{colour of geoms that stand still: share of a view's pictures that it paints}.

    Of some of (n, S) states; empty for a view without a plate.
    """
    if simulator.views[view].plate is None:
        return {}
    some = states[np.linspace(0, len(states) - 1, _NUM_STATES).astype(int)]
    space, found = simulator.space, dict[str, float]()
    for name, columns in _still_colours(simulator).items():
        pictures = []
        for bound in ("low", "high"):
            worlds = np.tile(space.nominal, (len(some), 1))
            worlds[:, columns] = [getattr(space.parameters[i], bound) for i in columns]
            pictures.append(apart(simulator.render(some, worlds), simulator.widths)[view])
        found[name] = float((pictures[0] != pictures[1]).any(-1).mean())
    return found


def hidden_background(painted: Mapping[str, float]) -> list[str]:
    """A sentence for each colour that hides most of a recorded background."""
    return [
        f'colour {name!r} paints {share:.0%} of the picture over background = "recording": drop '
        "one of the two"
        for name, share in painted.items()
        if share > _MIN_PICTURES_SHARE
    ]


def _still_colours(simulator: Simulator) -> dict[str, list[int]]:
    """{name of a colour, without its channel: indices of its parameters}, of what stands still."""
    model, space = simulator.model, simulator.space
    drawn = stands_still(model) & (before_plate(model, space).geom_rgba[:, 3] > 0)
    found: dict[str, list[int]] = {}
    for i, parameter in enumerate(space.parameters):
        if parameter.is_appearance and drawn[geoms_coloured_by(model, parameter)].any():
            name = parameter.name[:-2] if parameter.is_colour else parameter.name
            found.setdefault(name, []).append(i)
    return found
