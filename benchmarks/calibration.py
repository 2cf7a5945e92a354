"""Do 90 % intervals hold the truth 90 % of the time? Simulation-based calibration.

A search tunes to one random world, as `simtune tune` does: in the first range only, or in a
narrowed one after that. Then worlds are drawn from the range that its last round searched, filmed,
and estimated by the detector, posterior network and fit of that round, as the real world was; the
rank of each truth in its own curve is uniform where intervals can be trusted (Talts et al. 2018).
A fit has less time than in `simtune tune`, since there are many. What one search got wrong all its
worlds share, so every so many of them another one begins, with another random world.

Worlds that are done already, in OUT, are not done again: those of this project are in
docs/calibration. The last line is one JSON object.
"""

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro
from baselines.one_run import true_parameters
from common import QUICK, machine, record_figures
from searching import context_of

from simtune.budget import Budget
from simtune.real.truth import Truth
from simtune.tasks import TASKS, Task, load_task
from simtune.trajectory import Trajectory
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.range_update import candidate_grid

_INSIDE = (0.05, 0.95)
_SEARCHES = {"first": (1.0,), "narrowed": PosteriorSearchConfig().time_shares}


def main(
    tasks: tuple[str, ...] = tuple(TASKS),
    worlds: int = 40,
    worlds_per_search: int = 20,
    minutes: float = 6.0,
    real_episodes: int = 5,
    at_most_minutes: float = 60.0,
    out: Path = Path("runs/calibration"),
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        tasks: Which of the built-in ones.
        worlds: To draw from each task's two ranges.
        worlds_per_search: Of them.
        minutes: For each search.
        real_episodes: Of each world, 200 steps each.
        at_most_minutes: For each search's worlds.
        out: Folder for the ranks, a JSON lines file for each task and range.
        record: Write the figures into this file of docs/results, too.
        quick: A world of each range, no time to learn, nothing kept.
    """
    config, found = PosteriorSearchConfig(fit_share=0.05), {}
    with tempfile.TemporaryDirectory() as temporary:
        if quick:
            tasks, worlds, minutes, real_episodes = tasks[-1:], 1, 0.1, 1
            out, config = Path(temporary), QUICK
        out.mkdir(parents=True, exist_ok=True)
        for name in tasks:
            task = load_task(name)
            for label, shares in _SEARCHES.items():
                asked = replace(config, num_rounds=len(shares), time_shares=shares)
                ranks = _Ranks(out / f"{name}-{label}.jsonl", task, asked, real_episodes)
                for number in range(-(-worlds // worlds_per_search)):
                    until = min(worlds, (number + 1) * worlds_per_search)
                    ranks.append(number, until, minutes, at_most_minutes)
            for path in sorted(out.glob(f"{name}-*.jsonl")):
                found[path.stem] = summary(path)
                print(f"{path.stem}: {found[path.stem]}", file=sys.stderr)
    rows = []
    for name, figures in found.items():
        task, _, label = name.rpartition("-")
        rows.append({"task": task, "range": label, **figures})
    record_figures(record, ("task", "range"), rows)
    print(json.dumps({"benchmark": "calibration", "quick": quick, **machine(), "ranges": found}))


class _Ranks:
    """Of worlds of one task and range, a line a world in a file."""

    def __init__(self, path: Path, task: Task, config: PosteriorSearchConfig, episodes: int):
        self._path, self._task, self._config, self._episodes = path, task, config, episodes
        self._simulator = task.simulator(image_size=64)

    def append(self, number: int, until: int, minutes: float, at_most_minutes: float) -> None:
        """By search `number`, until there are so many; nothing if there are.

        It is also the number of the random world that the search tunes to.
        """
        done = len(self._path.read_text().splitlines()) if self._path.exists() else 0
        if done >= until:
            return
        search = self._searched(number, minutes)
        end_s = time.monotonic() + 60 * at_most_minutes
        while done < until and time.monotonic() < end_s:
            # By its number, so that a run that goes on draws others than those it has.
            drawn = search.searched.sample(1, np.random.default_rng((1, done)))[0]
            trajectories = self._film(Truth(self._task.parameters, drawn), done)
            ranks = ranks_of(search, trajectories, drawn).round(4)
            with self._path.open("a") as lines:
                lines.write(json.dumps(self._task.parameters.to_dict(ranks)) + "\n")
            done += 1

    def _searched(self, number: int, minutes: float) -> PosteriorSearch:
        task, space = self._task, self._task.parameters
        known = Truth(space, space.from_dict(true_parameters(task.name, space, number)))
        start = known.wrong_start(number)
        context = context_of(task, self._simulator, start, number)
        search = PosteriorSearch(context, self._config)
        real, budget = self._film(known, number), Budget(60 * minutes)
        while not search.stop_reason:
            search.run_round(real, budget)
        return search

    def _film(self, truth: Truth, seed: int) -> list[Trajectory]:
        steps = self._task.episode_steps
        world = truth.make_real(self._simulator, episode_steps=steps, seed=seed)
        return world.collect(self._episodes)


def ranks_of(
    search: PosteriorSearch, trajectories: list[Trajectory], truth: np.ndarray
) -> np.ndarray:
    """(N,) probabilities, by a world's curves, of being below its truth."""
    _, prob_higher = search.estimate(trajectories)
    grid, in_range = candidate_grid(), search.searched.to_range_unit(truth)
    curves = zip(in_range, prob_higher, strict=True)
    return np.array([1 - np.interp(at, grid, curve) for at, curve in curves])


def summary(path: Path) -> dict[str, object]:
    """Worlds, coverage of all and of each parameter's 90 % intervals."""
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    ranks = np.array([list(row.values()) for row in rows])
    inside = (ranks > _INSIDE[0]) & (ranks < _INSIDE[1])
    each = dict(zip(rows[0], inside.mean(0).round(3).tolist(), strict=True))
    lowest = min(each, key=each.__getitem__)
    histogram = np.histogram(ranks, 10, (0, 1))[0].tolist()
    return {
        "worlds": len(rows),
        "coverage": round(float(inside.mean()), 3),
        "coverage_of_each": each,
        "lowest": {lowest: each[lowest]},
        "histogram": histogram,
    }


if __name__ == "__main__":
    tyro.cli(main)
