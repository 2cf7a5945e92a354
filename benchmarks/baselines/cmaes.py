"""CMA-ES on the pixels: the parameters whose replay of the real actions looks most like the video.

A video does not say what state it starts from, so each episode's start is searched for as
simtune's comparison does it (`find_start`), with the best parameters so far, once a phase; within
a phase all candidates start from there. Only the first steps of an episode are compared: later
ones depend on the start's last digits. It gives a point, no interval.
"""

import time

import numpy as np

from baselines import Found, Problem
from simtune.before_after.start_search import find_start
from simtune.simulation import Rollouts

_PHASES = 3
_SPREAD = 0.3  # of the first phase's candidates, in coordinates of the range; then half of it, ...
_COMPARED_STEPS = 40
_EVERY = 4  # so many steps from one compared picture to the next


def find(problem: Problem) -> Found:
    import cma

    first, simulator = problem.first, problem.simulator
    rng = np.random.default_rng(problem.seed)
    best, began_s = np.full(len(first.space), 0.5), time.monotonic()
    for phase in range(_PHASES):
        share = (phase + 1) / _PHASES
        phase_steps = share * problem.budget_steps
        phase_end_s = began_s + share * (problem.deadline_s - began_s)
        starts = [find_start(simulator, t, first.from_range_unit(best), rng) for t in problem.real]
        distances = _Distances(problem, np.array(starts), rng)
        options = {"bounds": [0, 1], "seed": problem.seed + 1, "verbose": -9}
        strategy = cma.CMAEvolutionStrategy(best, _SPREAD * 0.5**phase, options)
        while True:  # at least one generation, however late it is
            candidates = strategy.ask()
            strategy.tell(candidates, distances(np.array(candidates)).tolist())
            late = time.monotonic() > phase_end_s or simulator.num_steps > phase_steps
            if late or strategy.stop():
                break
        best = np.clip(strategy.result.xfavorite, 0, 1)
    return Found(first.space.to_dict(first.from_range_unit(best)))


class _Distances:
    """Mean squared pixel distances between the real episodes and candidates' replays of them."""

    def __init__(self, problem: Problem, starts: np.ndarray, rng: np.random.Generator):
        self._problem, self._starts, self._rng = problem, starts, rng
        steps = min(_COMPARED_STEPS, *map(len, problem.real))
        self._steps = np.arange(0, steps + 1, _EVERY)
        self._actions = np.stack([t.actions[:steps] for t in problem.real]).astype(float)
        self._frames = np.stack([t.frames[self._steps] for t in problem.real])  # (E, F, H, H, 3)

    def __call__(self, candidates: np.ndarray) -> np.ndarray:
        """(n,) of (n, N) candidates in coordinates of the range; worlds that diverge are worst."""
        num, episodes = len(candidates), len(self._starts)
        parameters = self._problem.first.from_range_unit(candidates)
        rollouts = self._problem.simulator.roll_out(
            np.repeat(parameters, episodes, axis=0),
            np.tile(self._actions, (num, 1, 1)),
            self._rng,
            starts=np.tile(self._starts, (num, 1)),
        )
        distances = np.full(num * episodes, 255.0**2)
        distances[rollouts.index] = self._compare(rollouts, rollouts.index % episodes)
        return distances.reshape(num, episodes).mean(1)

    def _compare(self, rollouts: Rollouts, episode: np.ndarray) -> np.ndarray:
        seen = rollouts.states[:, self._steps]
        parameters = np.repeat(rollouts.parameters, len(self._steps), axis=0)
        frames = self._problem.simulator.render(seen.reshape(len(parameters), -1), parameters)
        frames = frames.reshape(len(seen), *self._frames.shape[1:]).astype(np.float32)
        return np.square(frames - self._frames[episode]).mean((1, 2, 3, 4))
