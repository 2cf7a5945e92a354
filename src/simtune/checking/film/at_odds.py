"""Films that move otherwise than their actions say, told by what would explain them.

Servos go where actions send them, whatever the parameters. So worlds of the first search range play
the recorded actions, and where a film does not agree with them at its own moments, it may do so
turned or mirrored, with an action's sign reversed, or with another episode's actions. The worlds
themselves, judged as if they were films, say what would be told of a right film: that is left out.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from simtune.checking.film.explanations import AtOdds, Worlds, each_moving
from simtune.checking.film.library import brought_to_size
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
) -> dict[int, AtOdds]:
    """What would explain films, {number of the view: (E, K, H, W, 3)}, where that is clear.

    `recorded`: the (T, A) actions of these episodes, by name.
    """
    are_few = not films or len(recorded) < _FEWEST_EPISODES
    if are_few or not position_servos(simulator.model).all():
        return {}
    played = Played(simulator, list(recorded.values()), seed)
    if not played.are_enough:
        return {}
    num = next(iter(films.values())).shape[1]
    small = {i: np.stack([brought_to_size(its) for its in film]) for i, film in films.items()}
    worlds = {i: Worlds(view) for i, view in enumerate(played.draw(num)) if i in films}
    poor = [i for i in films if worlds[i].is_poor(small[i])]
    if not poor:
        return {}
    late = [played.draw(num, steps) for steps in _LATE_STEPS]
    signs = dict(_reversed(simulator, recorded, num, seed))
    found = dict[int, AtOdds]()
    for i in poor:
        its_late = [each_moving(views[i]) for views in late]
        its_signs = {says: each_moving(views[i]) for says, views in signs.items()}
        if its := worlds[i].explain(small[i], its_late, its_signs, list(recorded)):
            found[i] = its
    return found


def _reversed(
    simulator: Simulator, recorded: Mapping[str, np.ndarray], num_pictures: int, seed: int
) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Whose sign is reversed, each action's or all, and each view's pictures of that."""
    names, num = simulator.action_mapping.names, simulator.num_actions
    signs = {f"the action {name}": 1 - 2 * np.eye(num)[i] for i, name in enumerate(names)}
    if num > 1:
        signs["all actions"] = -np.ones(num)
    for says, sign in signs.items():
        played = Played(simulator, [actions * sign for actions in recorded.values()], seed)
        if played.are_enough:
            yield says, played.draw(num_pictures)
