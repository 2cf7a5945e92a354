"""Shadows and reflections: real rooms have them, and simulated pictures are drawn without."""

from typing import NamedTuple

import numpy as np

_SHADOWED, _SHADOW = 0.8, (0.5, 1.0)  # share of rooms; a lamp's shadow is whole but for fill light
_REFLECTING, _MIRROR = 0.5, (0.0, 0.4)
_ASIDE = 0.3  # standard deviation, against a light's unit vector


class StrayLight(NamedTuple):
    """Of n worlds. Nobody knows a room's lamps and floors, so these are other in each world.

    Without it a detector takes a foot's mirror image for the foot, and the dark side of a leg for
    what is behind: keypoints come out some tenths of a pixel off, all to the same side.
    """

    shadow: np.ndarray  # (n,) share of a lamp's light that shadows lack
    mirror: np.ndarray  # (n,) share of what reaches the eye from a plane that it reflects
    aside: np.ndarray  # (n, 3) by how much shadows fall aside, against a lamp's unit vector

    @classmethod
    def none(cls, num: int) -> "StrayLight":
        """As the simulator draws by itself."""
        return cls(np.zeros(num), np.zeros(num), np.zeros((num, 3)))

    @classmethod
    def draw(cls, num: int, rng: np.random.Generator) -> "StrayLight":
        """Of `num` rooms."""
        shadow = rng.uniform(*_SHADOW, num) * (rng.random(num) < _SHADOWED)
        mirror = rng.uniform(*_MIRROR, num) * (rng.random(num) < _REFLECTING)
        return cls(shadow, mirror, rng.normal(0, _ASIDE, (num, 3)))

    def of(self, worlds: np.ndarray | slice) -> "StrayLight":
        """Of some of them, perhaps several times."""
        return StrayLight(*(its[worlds] for its in self))
