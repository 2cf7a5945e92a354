"""What would explain a film that does not agree with the worlds that play its actions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simtune.checking.film.features import agreement, moving_roughly
from simtune.checking.film.framing import AS_IT_IS, TURNS, Framing

_MIN_COSINE_GAIN = 0.09  # at its own moment over others: here nothing agrees by chance
_POOR_SHARE = 0.5  # of what is usual among the worlds: more needs no explanation
_MIN_RATIO = 2.5  # of an explanation's agreement to that of the film as it is
_TIE_SHARE = 0.7  # of the best agreement: explains as well
_TIED_GAIN = _TIE_SHARE * _MIN_COSINE_GAIN


@dataclass(frozen=True)
class AtOdds:
    """What would explain how a film moves: any of these."""

    framings: list[Framing] = field(default_factory=list)
    reversed: list[str] = field(default_factory=list)  # "the action turn", "all actions"
    actions_of: dict[str, str] = field(default_factory=dict)  # {episode: another, of some}

    def facts(self) -> dict[str, Any]:
        """For the result; JSON."""
        framings = [framing.says for framing in self.framings]
        return {"framings": framings, "reversed": self.reversed, "actions_of": self.actions_of}


class Worlds:
    """Pictures of W worlds that play a film's actions, at its moments."""

    def __init__(self, frames: np.ndarray):
        """`frames`: (W, E, K, SIZE, SIZE, 3)."""
        self.frames, self.moving = frames, each_moving(frames)

    def explain(
        self,
        film: np.ndarray,
        late: Sequence[np.ndarray],
        signs: Mapping[str, np.ndarray],
        episodes: Sequence[str],
    ) -> AtOdds | None:
        """What explains a film, (E, K, SIZE, SIZE, 3), that `is_poor`; None if nothing does.

        `late`: what moves in the worlds if pictures are late, `signs`: if actions' signs are
        reversed, (W, E, K, D). `episodes`: names.
        """
        shown = moving_roughly(film)
        own = max((_alike(shown, drawn) for drawn in (self.moving, *late)), key=np.mean)
        likest = max(agreement(shown, world).mean() for world in self.moving)
        turns = [self._clear(film, own, likest, framing, self.moving) for framing in TURNS]
        reversals = [self._clear(film, own, likest, AS_IT_IS, drawn) for drawn in signs.values()]
        best = max([*turns, *reversals])
        if best >= _MIN_COSINE_GAIN:
            tied = _TIE_SHARE * best
            return AtOdds(
                [framing for framing, alike in zip(TURNS, turns, strict=True) if alike > tied],
                [sign for sign, alike in zip(signs, reversals, strict=True) if alike > tied],
            )
        found = self._exchanged(shown, own)
        names = {episodes[i]: episodes[j] for i, j in found.items()}
        return AtOdds(actions_of=names) if names else None

    def is_poor(self, film: np.ndarray) -> bool:
        """Whether a film does not agree with these worlds, which agree with each other."""
        usual = np.median([self._own(w) for w in range(len(self.moving))], 0)
        own = _alike(moving_roughly(film), self.moving)
        return bool(usual.mean() >= _MIN_COSINE_GAIN and (own < _POOR_SHARE * usual).any())

    def _clear(
        self,
        film: np.ndarray,
        own: np.ndarray,
        likest: float,
        framing: Framing,
        drawn: np.ndarray,
    ) -> float:
        """Mean agreement by an explanation; 0 unless it is clear, and told of no world.

        That is clear, too, which is as good as the least of those that explain a film alone.

        `own`: (E,) agreement without any; `likest`: mean agreement with the likest world.
        """
        alike = _alike(_shown(film, framing), drawn)
        is_clear = _is_better(alike, own, _TIED_GAIN) and alike.mean() > likest
        worlds = range(len(self.moving))
        if not is_clear or any(self._is_told_of(w, framing, drawn) for w in worlds):
            return 0.0
        return float(alike.mean())

    def _exchanged(self, shown: np.ndarray, own: np.ndarray) -> dict[int, int]:
        """{episode: whose actions it plays}, unless the same is told of a world."""
        found = _exchanged(_table(shown, self.moving), own)
        if not found:
            return {}
        of_worlds = (
            _exchanged(_table(moving, self._but(w)), self._own(w))
            for w, moving in enumerate(self.moving)
        )
        return {} if any(of_worlds) else found

    def _is_told_of(self, world: int, framing: Framing, drawn: np.ndarray) -> bool:
        """Whether a world's own pictures would be explained like this."""
        others = drawn if drawn is not self.moving else self._but(world)
        return _is_better(_alike(_shown(self.frames[world], framing), others), self._own(world))

    def _own(self, world: int) -> np.ndarray:
        """(E,) agreement of a world with the others."""
        return _alike(self.moving[world], self._but(world))

    def _but(self, world: int) -> np.ndarray:
        return np.delete(self.moving, world, 0)


def each_moving(frames: np.ndarray) -> np.ndarray:
    """(W, E, K, D) what moves in each of (W, E, K, SIZE, SIZE, 3)."""
    return np.stack([moving_roughly(world) for world in frames])


def _shown(film: np.ndarray, framing: Framing) -> np.ndarray:
    return moving_roughly(film if framing is AS_IT_IS else framing.undo(film)[0])


def _alike(shown: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(E,) mean agreement with (W, E, K, D)."""
    return np.mean([agreement(shown, world) for world in drawn], 0)


def _is_better(alike: np.ndarray, own: np.ndarray, least: float = _MIN_COSINE_GAIN) -> bool:
    """Whether (E,) agreements are clearly those of an explanation, in all episodes."""
    return bool(alike.mean() >= max(least, _MIN_RATIO * own.mean()) and (alike > own).all())


def _table(shown: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(E, E) mean agreement of each episode with the actions of each."""
    num = range(len(shown))
    return np.array([[_alike(shown[[i]], drawn[:, [j]])[0] for j in num] for i in num])


def _exchanged(table: np.ndarray, own: np.ndarray) -> dict[int, int]:
    """{episode: another one whose actions agree}, of two or more; (E, E) and (E,)."""
    others = np.where(np.eye(len(table), dtype=bool), -np.inf, table)
    best = others.argmax(1)
    clear = others.max(1) >= np.maximum(_MIN_COSINE_GAIN, _MIN_RATIO * own)
    found = {i: int(best[i]) for i in np.flatnonzero(clear).tolist()}
    return found if len(found) > 1 and len({*found.values()}) == len(found) else {}
