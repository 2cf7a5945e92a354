"""Shadows, reflections and backgrounds, which real rooms have and simulated pictures lack."""

from typing import NamedTuple

import numpy as np

_SHADOWED_SHARE, _SHADOW_BOUNDS = 0.8, (0.5, 1.0)  # of rooms; a shadow is full but for fill light
_REFLECTING_SHARE, _MIRROR_BOUNDS = 0.5, (0.0, 0.4)
_NUM_BACKDROPS = 2**31
_DIRECTION_STD = 0.3  # relative to a light's unit vector


class StrayLight(NamedTuple):
    """Of n worlds. A room's lamps and floors are unknown, so these are drawn for each world.

    Without them a detector takes a foot's mirror image for the foot, and a leg's dark side for the
    background: keypoints are some tenths of a pixel off, all to the same side.
    """

    shadow: np.ndarray  # (n,) share of a lamp's light that is missing in shadows
    mirror: np.ndarray  # (n,) share of reflection in what a plane sends to the eye
    aside: np.ndarray  # (n, 3) offset of a shadow's direction, relative to a lamp's unit vector
    backdrop: np.ndarray  # (n,) number of a picture, see `Backdrops`; 0: none

    @classmethod
    def none(cls, num: int) -> "StrayLight":
        """As the simulator draws by itself."""
        return cls(np.zeros(num), np.zeros(num), np.zeros((num, 3)), np.zeros(num, int))

    @classmethod
    def draw(cls, num: int, rng: np.random.Generator) -> "StrayLight":
        """For `num` rooms."""
        shadow = rng.uniform(*_SHADOW_BOUNDS, num) * (rng.random(num) < _SHADOWED_SHARE)
        mirror = rng.uniform(*_MIRROR_BOUNDS, num) * (rng.random(num) < _REFLECTING_SHARE)
        backdrop = rng.integers(1, _NUM_BACKDROPS, num)
        return cls(shadow, mirror, rng.normal(0, _DIRECTION_STD, (num, 3)), backdrop)

    def to_rows(self) -> np.ndarray:
        """(n, 6) float64, to be stored; see `from_rows`."""
        return np.column_stack([self.shadow, self.mirror, self.backdrop, self.aside])

    @classmethod
    def from_rows(cls, rows: np.ndarray) -> "StrayLight":
        """The inverse of `to_rows`."""
        shadow, mirror, backdrop = rows[:, :3].T
        return cls(shadow, mirror, rows[:, 3:], backdrop.astype(int))

    def of(self, worlds: np.ndarray | slice) -> "StrayLight":
        """Of some worlds, perhaps repeated."""
        return StrayLight(*(values[worlds] for values in self))

    def in_frames(self, num: int) -> "StrayLight":
        """Of `num` frames of each, one after the other: a camera that moves has more behind it."""
        frames = self.of(np.repeat(np.arange(len(self.shadow)), num))
        following = np.tile(np.arange(num), len(self.shadow))
        return frames._replace(backdrop=frames.backdrop + following)
