"""Whether a film can be of the simulator's scene: what stands, what moves, how it is framed.

Neither the parameters nor where things were is known. So pictures are compared with those of many
worlds drawn from the first range of a search, which play the recorded actions, by `features`
alone. How like each other pictures of one scene are is asked of these worlds, too: what counts as
unlike differs from scene to scene.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.checking.features import describe, likeness, moving_share
from simtune.checking.framing import AS_IT_IS, FRAMINGS, Framing
from simtune.checking.library import Library, brought_to_size

_JUDGED = (10, 6)  # worlds and pictures of each, which are taken for films themselves
_ALIKE = 0.6  # times as like as the simulator's worlds are to each other
_GAIN = 1.03  # by which another framing has to be liker than the film's own
_SLACK = 0.75  # times what another framing gains in the simulator's own worlds
_STILL = 0.05  # of what moves in the other, the film or the simulator's worlds
_SOME = 1e-3  # of the pixels: a film in which less moves is of nothing that moves
_STUCK = (
    "things move in the film, and nothing moves in the simulator as it plays the recorded actions: "
    "the model is stuck, and no motion can be compared; does an actuator reach the joint, is it "
    "locked or held by its limits, or is something in the way?"
)


@dataclass(frozen=True)
class Comparison:
    """Of a film with a simulator's pictures."""

    alike: float  # 1: as like them as pictures of the simulator's own worlds are
    framing: Framing  # among those known, the one whose undoing makes the film liker
    gain: float  # by so many times
    needed_gain: float  # before that tells anything in this scene
    framed_alike: float  # `alike`, once the framing is undone
    moving_share: float  # of the pixels
    simulated_moving_share: float
    nearest: np.ndarray  # (E, K) of the library's W · K pictures, to each of the film's

    @property
    def is_reframed(self) -> bool:
        """Whether the film is surely framed in another way."""
        return self.gain > self.needed_gain

    def facts(self) -> dict[str, Any]:
        """What to note down; JSON."""
        return {
            "alike": self.alike,
            "framing": self.framing.says if self.is_reframed else None,
            "gain": self.gain,
            "needed_gain": self.needed_gain,
            "moving_share": self.moving_share,
            "simulated_moving_share": self.simulated_moving_share,
        }

    @property
    def warnings(self) -> list[str]:
        """A sentence, where the film cannot be of the simulator's scene as its camera sees it."""
        if self.simulated_moving_share < _STILL * self.moving_share > _STILL * _SOME:
            return [_STUCK]
        if self.moving_share < _STILL * self.simulated_moving_share:
            return ["nothing moves in the film, though the simulator's parts do: is it this scene?"]
        other = "and even then another scene than the simulator's, or seen from elsewhere"
        if self.is_reframed:
            also = f", {other}" * (self.framed_alike < _ALIKE)
            return [f"beside the simulator's pictures the film looks {self.framing.says}{also}"]
        if self.alike < _ALIKE:
            return [
                "the film looks like another scene than the simulator's, or seen from elsewhere: "
                f"{self.alike:.2f} times as like it as the simulator's own worlds are to each other"
            ]
        return []


def compare(film: np.ndarray, library: Library) -> Comparison:
    """One camera's film, (E, K, H, W, 3) uint8 of E episodes, with a library."""
    film = np.stack([brought_to_size(each) for each in film])
    usual = np.maximum(_own_likeness(library), 1e-3)
    found = [_best(film, framing, library).mean((1, 2)) for framing in FRAMINGS]
    best = int(np.argmax([f.sum() for f in found]))
    own = _best(film, AS_IT_IS, library).mean((1, 2))
    both = likeness(describe(film), library.features).sum(0)
    return Comparison(
        alike=_times(own, usual),
        framing=FRAMINGS[best],
        gain=_gain(found[best], own),
        needed_gain=_GAIN + _SLACK * max(0, _own_gain(library) - 1),
        framed_alike=_times(found[best], usual),
        moving_share=float(moving_share(film).mean()),
        simulated_moving_share=float(moving_share(library.frames).mean()),
        nearest=both.argmax(1).reshape(film.shape[:2]),
    )


def _best(
    film: np.ndarray, framing: Framing, library: Library, but: np.ndarray | None = None
) -> np.ndarray:
    """(2, E, K) how like each picture, brought back, is to the liker of the library's, both ways.

    For episode e pictures of the world `but[e]` are left out.
    """
    undone, seen = framing.undo(film) if framing is not AS_IT_IS else (film, None)
    alike = likeness(describe(undone, seen), library.features)
    if but is not None:
        own = np.repeat(but, film.shape[1])[:, None] == library.worlds
        alike[:, own] = -np.inf
    return _of_nearest(alike).reshape(2, *film.shape[:2])


def _own_likeness(library: Library) -> np.ndarray:
    """(2,) the median over worlds of how like a world's pictures are to those of others."""
    worlds = library.worlds
    alike = likeness(library.features, library.features)
    alike[:, worlds[:, None] == worlds] = -np.inf
    each = _of_nearest(alike).reshape(2, len(library.frames), -1)
    return np.median(each.mean(2), 1)


def _of_nearest(alike: np.ndarray) -> np.ndarray:
    """(2, n) of (2, n, m) likenesses those to the picture that is the liker in both ways."""
    nearest = alike.sum(0).argmax(1)
    return alike[:, np.arange(len(nearest)), nearest]


def _own_gain(library: Library) -> float:
    """The largest gain by another framing that some of the library's own worlds show."""
    worlds, pictures = (
        np.linspace(0, length - 1, num).astype(int)
        for length, num in zip(library.frames.shape, _JUDGED, strict=False)
    )
    film = library.frames[worlds][:, pictures]
    own = _best(film, AS_IT_IS, library, worlds).mean(2)
    found = (_best(film, framing, library, worlds).mean(2) for framing in FRAMINGS)
    return max(_gain(*each) for f in found for each in zip(f.T, own.T, strict=True))


def _gain(framed: np.ndarray, own: np.ndarray) -> float:
    """How many times as like, in both ways together."""
    return float(max(framed.sum(), 0) / max(own.sum(), 1e-3))


def _times(alike: np.ndarray, usual: np.ndarray) -> float:
    """(2,) likenesses in units of the usual ones, multiplied: one that lacks spoils all."""
    return float(np.prod(np.maximum(alike, 0) / usual))
