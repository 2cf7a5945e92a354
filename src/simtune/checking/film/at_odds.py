"""Films that move otherwise than their actions say, told by what would explain them.

Servos go where actions send them, whatever the parameters. So worlds of the first search range play
the recorded actions, and where a film does not agree with them at its own moments, it may do so
turned or mirrored, with an action's sign reversed, or with another episode's actions. The worlds
themselves, judged as if they were films, say what would be told of a right film: that is left out.
"""

import time
from collections.abc import Iterator, Mapping

import numpy as np

from simtune.budget import NO_LIMIT, Budget, OutOfTime
from simtune.checking.film.explanations import AtOdds, Worlds, each_moving
from simtune.checking.film.played import Played
from simtune.simulation import Simulator
from simtune.simulation.servos import position_servos

_LATE_STEPS = (-2, -1, 1, 2, 3)  # by which pictures may be late: any is right
_FEWEST_EPISODES = 2  # of one, anything may agree by chance


def at_odds(
    films: Mapping[int, np.ndarray],
    simulator: Simulator,
    recorded: Mapping[str, np.ndarray],
    seed: int,
    budget: Budget = NO_LIMIT,
) -> dict[int, AtOdds]:
    """What would explain films, {number of the view: (E, K, SIZE, SIZE, 3)}, where that is clear.

    `recorded`: the (T, A) actions of these episodes, by name. Raises OutOfTime if a film needs an
    explanation and the `budget` leaves too little time to look for one.
    """
    are_few = not films or len(recorded) < _FEWEST_EPISODES
    if are_few or not position_servos(simulator.model).all():
        return {}
    budget.report("playing the recorded actions in other worlds")
    began_s = time.monotonic()
    played = Played(simulator, list(recorded.values()), seed)
    if not played.are_enough:
        return {}
    played_s = time.monotonic() - began_s
    num = next(iter(films.values())).shape[1]
    worlds = {i: Worlds(view) for i, view in enumerate(played.draw(num)) if i in films}
    poor = [i for i in films if worlds[i].is_poor(films[i])]
    if not poor:
        return {}
    drawn_s, num_signs = time.monotonic() - began_s - played_s, len(_signs(simulator))
    needed_s = len(_LATE_STEPS) * drawn_s + num_signs * (played_s + drawn_s)
    if needed_s > budget.seconds_left:
        raise OutOfTime(f"would take about {needed_s:.0f} s")
    looking = f"looking for what explains the film, about {needed_s:.0f} s"
    budget.report(looking, 0.3)
    late = [played.draw(num, steps) for steps in _LATE_STEPS]
    budget.report(looking, 0.5)
    signs = dict(_reversed(simulator, recorded, num, seed))
    found = dict[int, AtOdds]()
    for i in poor:
        its_late = [each_moving(views[i]) for views in late]
        its_signs = {says: each_moving(views[i]) for says, views in signs.items()}
        if explained := worlds[i].explain(films[i], its_late, its_signs, list(recorded)):
            found[i] = explained
    return found


def _reversed(
    simulator: Simulator, recorded: Mapping[str, np.ndarray], num_pictures: int, seed: int
) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Whose sign is reversed, each action's or all, and each view's pictures of that."""
    for says, sign in _signs(simulator).items():
        played = Played(simulator, [actions * sign for actions in recorded.values()], seed)
        if played.are_enough:
            yield says, played.draw(num_pictures)


def _signs(simulator: Simulator) -> dict[str, np.ndarray]:
    """{whose sign is reversed: (A,) factors}."""
    names, num = simulator.action_mapping.names, simulator.num_actions
    signs = {f"the action {name}": 1 - 2 * np.eye(num)[i] for i, name in enumerate(names)}
    if num > 1:
        signs["all actions"] = -np.ones(num)
    return signs
