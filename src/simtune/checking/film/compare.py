"""How similar a film is to the simulator's pictures: background, motion, framing.

Neither the parameters nor the states are known. So pictures are compared with those of many worlds
drawn from the first search range, which play the recorded actions, by `features` alone. How similar
pictures of one scene are is measured in these worlds, too, since it differs from scene to scene.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.checking.film.features import describe, likeness, moving_share
from simtune.checking.film.framing import AS_IT_IS, FRAMINGS, Framing
from simtune.checking.film.library import Library

_JUDGED_SIZES = (10, 6)  # worlds, and pictures of each, that are judged as if they were films
_MIN_GAIN_FACTOR = 1.03  # in similarity, of another framing over the film's own
_CHANCE_GAIN_FACTOR = 0.75  # on the gain of other framings in the simulator's own worlds
# Of what a film lacks in similarity, the share that another framing must make up for. Worlds whose
# arm hangs elsewhere, or a shadow, make any framing a little more similar or less.
_MADE_UP_SHARE = 0.3


@dataclass(frozen=True)
class Comparison:
    """Comparison of a film with a simulator's pictures."""

    alike: float  # 1: as similar as pictures of the simulator's own worlds
    framing: Framing  # the known one whose reversal makes the film most similar
    gain: float  # factor of similarity by that
    needed_gain: float  # below which a gain means nothing in this scene
    framed_alike: float  # `alike`, after the framing is reversed
    moving_share: float  # of the pixels
    simulated_moving_share: float
    nearest: np.ndarray  # (E, K) nearest of the library's W · K pictures, for each of the film's

    @property
    def is_reframed(self) -> bool:
        """Whether the film is clearly framed differently."""
        return self.gain > self.needed_gain

    def facts(self) -> dict[str, Any]:
        """Facts for the result; JSON."""
        return {
            "alike": self.alike,
            "framing": self.framing.says if self.is_reframed else None,
            "gain": self.gain,
            "needed_gain": self.needed_gain,
            "moving_share": self.moving_share,
            "simulated_moving_share": self.simulated_moving_share,
        }


def compare(film: np.ndarray, library: Library) -> Comparison:
    """Compare one camera's film, (E, K, SIZE, SIZE, 3) uint8 of E episodes, with a library."""
    usual = np.maximum(_own_likeness(library), 1e-3)
    found = [_best(film, framing, library).mean((1, 2)) for framing in FRAMINGS]
    best = int(np.argmax([f.sum() for f in found]))
    own = _best(film, AS_IT_IS, library).mean((1, 2))
    both = likeness(describe(film), library.features).sum(0)
    by_chance = _CHANCE_GAIN_FACTOR * max(0, _own_gain(library) - 1)
    return Comparison(
        alike=_times(own, usual),
        framing=FRAMINGS[best],
        gain=_gain(found[best], own),
        needed_gain=max(_MIN_GAIN_FACTOR + by_chance, 1 + _MADE_UP_SHARE * (_gain(usual, own) - 1)),
        framed_alike=_times(found[best], usual),
        moving_share=float(moving_share(film).mean()),
        simulated_moving_share=float(moving_share(library.frames).mean()),
        nearest=both.argmax(1).reshape(film.shape[:2]),
    )


def _best(
    film: np.ndarray, framing: Framing, library: Library, but: np.ndarray | None = None
) -> np.ndarray:
    """(2, E, K) similarity of each picture, after reversing `framing`, to the most similar one.

    For episode e, pictures of the world `but[e]` are left out.
    """
    undone, seen = framing.undo(film) if framing is not AS_IT_IS else (film, None)
    alike = likeness(describe(undone, seen), library.features)
    if but is not None:
        own = np.repeat(but, film.shape[1])[:, None] == library.worlds
        alike[:, own] = -np.inf
    return _of_nearest(alike).reshape(2, *film.shape[:2])


def _own_likeness(library: Library) -> np.ndarray:
    """(2,) median over worlds of how similar a world's pictures are to those of others."""
    worlds = library.worlds
    alike = likeness(library.features, library.features)
    alike[:, worlds[:, None] == worlds] = -np.inf
    nearest = _of_nearest(alike).reshape(2, len(library.frames), -1)
    return np.median(nearest.mean(2), 1)


def _of_nearest(alike: np.ndarray) -> np.ndarray:
    """(2, n) of (2, n, m) similarities: to the picture with the largest sum."""
    nearest = alike.sum(0).argmax(1)
    return alike[:, np.arange(len(nearest)), nearest]


def _own_gain(library: Library) -> float:
    """Largest gain by another framing among some of the library's own worlds."""
    worlds, pictures = (
        np.linspace(0, length - 1, num).astype(int)
        for length, num in zip(library.frames.shape, _JUDGED_SIZES, strict=False)
    )
    film = library.frames[worlds][:, pictures]
    own = _best(film, AS_IT_IS, library, worlds).mean(2)
    found = (_best(film, framing, library, worlds).mean(2) for framing in FRAMINGS)
    return max(_gain(*each) for f in found for each in zip(f.T, own.T, strict=True))


def _gain(framed: np.ndarray, own: np.ndarray) -> float:
    """Ratio of similarities, both kinds together."""
    return float(max(framed.sum(), 0) / max(own.sum(), 1e-3))


def _times(alike: np.ndarray, usual: np.ndarray) -> float:
    """Product of (2,) similarities relative to the usual ones: one low value spoils all."""
    return float(np.prod(np.maximum(alike, 0) / usual))
