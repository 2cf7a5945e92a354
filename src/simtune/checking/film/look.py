"""Looks at what each camera filmed, beside the simulator's pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from simtune.budget import NO_LIMIT, Budget, OutOfTime
from simtune.checking.film.as_read import AsRead
from simtune.checking.film.at_odds import at_odds
from simtune.checking.film.camera_film import CameraFilm
from simtune.checking.film.compare import Comparison, compare
from simtune.checking.film.exchanged import exchanged
from simtune.checking.film.explanations import AtOdds
from simtune.checking.film.film_warnings import warnings_of_film
from simtune.checking.film.library import Library, make_libraries
from simtune.checking.film.painted import hidden_background, painted_over
from simtune.checking.film.resting import in_words, resting_parts
from simtune.checking.film.sway import sways, sways_in_words
from simtune.checking.film.turned import Turned, turned
from simtune.simulation import Simulator
from simtune.simulation.rendering.plate import camera_moves

_LEFT_OUT = (
    "what moves does not agree with worlds that play the recorded actions, and what would explain "
    "that was not looked for, which {}: is the film turned or mirrored, is an action's sign "
    "reversed, are files exchanged?"
)


class Why(NamedTuple):
    """What explains that a film is unlike the simulator, as far as something does."""

    other: str | None  # the camera whose film it seems to have instead
    turn: Turned | None
    odd: AtOdds | None

    def facts(self) -> dict[str, Any]:
        """JSON."""
        return {
            "exchanged_with": self.other,
            "against_readings": self.turn and self.turn.says,
            "against_actions": self.odd and self.odd.facts(),
        }


class Look(NamedTuple):
    """What one camera filmed, beside the simulator's pictures."""

    film: CameraFilm
    library: Library
    comparison: Comparison
    why: Why
    warnings: list[str]
    sway_px: Mapping[str, float]  # {episode: of 64}, where what stands still moves

    def facts(self) -> dict[str, Any]:
        """JSON."""
        return self.comparison.facts() | self.why.facts() | {"sway_px": dict(self.sway_px)}


def look_at(
    films: list[CameraFilm],
    simulator: Simulator,
    actions: np.ndarray,
    seed: int,
    as_read: AsRead | None = None,
    recorded: Mapping[str, np.ndarray] | None = None,
    budget: Budget = NO_LIMIT,
) -> list[Look]:
    """At each film, whose episodes play these (E, T, A) actions; empty if most worlds diverge.

    `as_read`: the films' episodes as joint readings have them. `recorded`: whole (T, A) actions of
    episodes by name, the films' first; without them, films are not compared moment by moment.
    `budget`: for that comparison; a warning says if it was left out.
    """
    budget.report("drawing worlds of the simulator")
    libraries = make_libraries(simulator, actions[: len(films[0].frames)], seed)
    if not libraries:
        return []
    instead = _exchanged(films, libraries)
    turns = _turned(films, simulator, as_read)
    odds, left_out = dict[str, AtOdds](), ""
    try:
        asked = budget.share(1.0, (0.3, 1.0))
        odds = _at_odds(films, simulator, recorded, seed, {*instead, *turns}, asked)
    except OutOfTime as error:
        left_out = _LEFT_OUT.format(error)
    looks = []
    for i, (film, library) in enumerate(zip(films, libraries, strict=True)):
        why = Why(instead.get(film.name), turns.get(film.name), odds.get(film.name))
        looks.append(_look_at_one(i, film, library, simulator, why))
    if left_out:
        looks[0].warnings.append(left_out)
    return looks


def named_warnings(looks: Sequence[Look]) -> list[str]:
    """Of all cameras, which are named if there are several."""
    named = [(f"camera {look.film.name}: " * (len(looks) > 1), look) for look in looks]
    return [f"{whose}{warning}" for whose, look in named for warning in look.warnings]


def _look_at_one(
    number: int, film: CameraFilm, library: Library, simulator: Simulator, why: Why
) -> Look:
    """At the film of one camera, the simulator's view `number`."""
    comparison = compare(film.squares, library)
    states = library.states.reshape(-1, library.states.shape[-1])
    film = replace(film, painted=painted_over(simulator, states, number))
    moves = camera_moves(simulator.model, film.view.camera)
    warned = warnings_of_film(film, comparison, *why, camera_moves=moves)
    if why.other is None and (rest := resting_parts(simulator, library, number)):
        warned.append(in_words(rest))
    hidden = hidden_background(film.painted) if film.is_plate else []
    can_sway = not moves and not film.view.background_is_unknown
    sway = sways(film) if can_sway else {}
    said = [sways_in_words(sway, film)] if sway else []
    return Look(film, library, comparison, why, [*warned, *said, *hidden], sway)


def _exchanged(films: list[CameraFilm], libraries: list[Library]) -> dict[str, str]:
    """{camera: whose film it seems to have instead}."""
    pairs = exchanged(films, libraries)
    return {films[i].name: films[j].name for i, j in pairs.items()}


def _turned(
    films: list[CameraFilm], simulator: Simulator, as_read: AsRead | None
) -> dict[str, Turned]:
    """{still camera: how its film is turned}, as far as readings say so."""
    still = {i: films[i].squares for i in _still(films, simulator)}
    if as_read is None or not as_read.joints or not still:
        return {}
    return {films[i].name: turn for i, turn in turned(still, as_read).items()}


def _at_odds(
    films: list[CameraFilm],
    simulator: Simulator,
    recorded: Mapping[str, np.ndarray] | None,
    seed: int,
    but: set[str],
    budget: Budget,
) -> dict[str, AtOdds]:
    """{still camera: what explains its film beside its actions}, `but` those explained already."""
    still = {i: films[i].squares for i in _still(films, simulator) if films[i].name not in but}
    if not recorded or not still:
        return {}
    names = [*recorded][: len(films[0].frames)]
    actions = {name: recorded[name] for name in names}
    found = at_odds(still, simulator, actions, seed, budget)
    return {films[i].name: odd for i, odd in found.items()}


def _still(films: list[CameraFilm], simulator: Simulator) -> list[int]:
    """Numbers of the cameras that do not move."""
    model = simulator.model
    return [i for i, film in enumerate(films) if not camera_moves(model, film.view.camera)]
