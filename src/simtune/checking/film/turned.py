"""Films that are mirrored or turned, told by what moves when readings say so.

A pusher on a table, or a cart on a rail, looks much the same upside down. Readings say where it is
at each moment, so what moves in a film is compared with what moves where it is drawn at that
moment, less how alike they are at other moments.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from simtune.checking.film.as_read import AsRead
from simtune.checking.film.features import agreement, moving
from simtune.checking.film.framing import TURNS, Framing

_LATE_STEPS = range(-2, 4)  # by which pictures may be late beside readings: any is right
_MIN_COSINE_GAIN = 0.1  # at its own moment over others: here nothing agrees by chance
_MIN_RATIO = 2.0  # of a turned film's agreement to that of it as it is, in all episodes
_TIE_SHARE = 0.9  # of the best agreement: as good
# Share of the best agreement that other readings must reach to explain the film as well
_OTHERS_SHARE = 0.7


@dataclass(frozen=True)
class Turned:
    """How a film seems to be turned, beside readings, and what would explain it as well."""

    framings: list[Framing]  # that agree alike
    reversed: list[str]  # joints with the other sign
    elsewhere: str | None = None  # a hinge whose zero is a quarter or half a turn away

    @property
    def says(self) -> str:
        """In words."""
        return " or ".join(framing.says for framing in self.framings)


def turned(films: Mapping[int, np.ndarray], as_read: AsRead) -> dict[int, Turned]:
    """How (E, K, SIZE, SIZE, 3) films are turned, {number of the view: film}, where that is clear.

    `as_read`: the same episodes.
    """
    num = next(iter(films.values())).shape[1]
    views = [as_read.draw(num, late) for late in _LATE_STEPS]
    found = dict[int, Turned]()
    for view, film in films.items():
        drawn = [moving(drawings[view]) for drawings in views]
        if turn := _turned(film, view, drawn, as_read):
            found[view] = turn
    return found


def _turned(film: np.ndarray, view: int, drawn: list[np.ndarray], as_read: AsRead) -> Turned | None:
    """`drawn`: what moves in a view, for each lateness."""
    shown = moving(film)
    own, _ = _best(shown, drawn)
    alike = [_best(moving(framing.undo(film)[0]), drawn) for framing in TURNS]
    best = int(np.argmax([agreed.mean() for agreed, _ in alike]))
    agreed, late = alike[best]
    if agreed.mean() < max(_MIN_COSINE_GAIN, _MIN_RATIO * own.mean()) or (agreed <= own).any():
        return None
    pairs = zip(TURNS, alike, strict=True)
    found = [framing for framing, (one, _) in pairs if one.mean() > _TIE_SHARE * agreed.mean()]
    other = _OtherReadings(shown, view, as_read, _LATE_STEPS[late], _OTHERS_SHARE * agreed.mean())
    could_turn = any(not framing.is_mirrored for framing in found)
    return Turned(found, other.signs(), other.zero() if could_turn else None)


@dataclass(frozen=True)
class _OtherReadings:
    """What of readings, if changed, explains the film as it is."""

    shown: np.ndarray  # (E, K, D) what moves in the film
    view: int
    as_read: AsRead
    late_steps: int
    needed: float  # agreement

    def signs(self) -> list[str]:
        """Names of one or two joints with the other sign; or none."""
        names, changed = list[str](), dict[int, tuple[float, float]]()
        for _ in range(2):
            joints = [joint for joint in self.as_read.joints if joint[1] not in changed]
            tried = [(self._alike({**changed, at: (-1.0, 0.0)}), name, at) for name, at in joints]
            if not tried:
                break
            alike, name, at = max(tried)
            names, changed = [*names, name], {**changed, at: (-1.0, 0.0)}
            if alike > self.needed:
                return names
        return []

    def zero(self) -> str | None:
        """A hinge whose zero may be a quarter or half a turn away."""
        hinges = [joint for joint in self.as_read.joints if self.as_read.is_hinge(joint[1])]
        tried = [
            (self._alike({at: (1.0, turn)}), name)
            for name, at in hinges
            for turn in (-np.pi / 2, np.pi / 2, np.pi)
        ]
        alike, name = max(tried, default=(0.0, ""))
        return name if alike > self.needed else None

    def _alike(self, changed: dict[int, tuple[float, float]]) -> float:
        num = self.shown.shape[1]
        drawn = self.as_read.draw(num, self.late_steps, changed)[self.view]
        return float(agreement(self.shown, moving(drawn)).mean())


def _best(shown: np.ndarray, drawn: list[np.ndarray]) -> tuple[np.ndarray, int]:
    """(E,) agreement at the delay at which it is largest, and that delay's index."""
    found = [agreement(shown, late) for late in drawn]
    best = int(np.argmax([agreed.mean() for agreed in found]))
    return found[best], best
