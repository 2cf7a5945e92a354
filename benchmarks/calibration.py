"""Do 90 % intervals hold the truth 90 % of the time? Simulation-based calibration.

A search tunes to one random world, as `simtune tune` does: once in the first range only, once in
a narrowed one after that. Then worlds are drawn from the range that its last iteration searched,
filmed, and looked at by the sight, judge and fit of that iteration, just as the real world was; the
rank of each truth in its own curve is uniform where intervals can be trusted (Talts et al. 2018).
A fit has less time than in `simtune tune`, since there are many.

Worlds that are done already, in OUT, are not done again. The last line is one JSON object.
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
from common import QUICK, machine

from simtune.real.truth import Truth
from simtune.tasks import TASKS, Task, load_task
from simtune.trajectory import Trajectory
from simtune.tuning.moves import candidate_grid
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig

_INSIDE = (0.05, 0.95)
_SEARCHES = {"first": (1.0,), "narrowed": PosteriorSearchConfig().time_shares}


def main(
    tasks: tuple[str, ...] = tuple(TASKS),
    worlds: int = 200,
    minutes: float = 6.0,
    real_episodes: int = 5,
    at_most_minutes: float = 60.0,
    out: Path = Path("runs/calibration"),
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        tasks: Which of the built-in ones.
        worlds: To draw from each of the two ranges.
        minutes: For each search.
        real_episodes: Of each world, 200 steps each.
        at_most_minutes: For each range's worlds.
        out: Folder for the ranks, a JSON lines file for each task and range.
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
            calibrate(task, config, worlds, minutes, real_episodes, at_most_minutes, out)
            for path in sorted(out.glob(f"{name}-*.jsonl")):
                found[path.stem] = summary(path)
                print(f"{path.stem}: {found[path.stem]}", file=sys.stderr)
    print(json.dumps({"benchmark": "calibration", "quick": quick, **machine(), "ranges": found}))


def calibrate(
    task: Task,
    config: PosteriorSearchConfig,
    worlds: int,
    minutes: float,
    episodes: int,
    at_most_minutes: float,
    out: Path,
) -> None:
    """Append ranks to OUT/TASK-first.jsonl and OUT/TASK-narrowed.jsonl."""
    simulator, space = task.simulator(image_size=64), task.parameters
    truth = space.from_dict(true_parameters(task.name, space, 0))
    known = Truth(space, truth)
    world = known.make_real(simulator, episode_steps=task.episode_steps, seed=0)
    real = world.collect(episodes)
    for label, shares in _SEARCHES.items():
        path = out / f"{task.name}-{label}.jsonl"
        done = len(path.read_text().splitlines()) if path.exists() else 0
        if done >= worlds:
            continue
        asked = replace(config, iterations=len(shares), time_shares=shares)
        search = PosteriorSearch(simulator, task.camera, known.wrong_start(0), asked, seed=0)
        end_s = time.monotonic() + 60 * minutes
        while not search.finished:
            search.iterate(real, end_s)
        end_s = time.monotonic() + 60 * at_most_minutes
        while done < worlds and time.monotonic() < end_s:
            # By its number, so that a run that goes on draws others than those it has.
            drawn = search.searched.sample(1, np.random.default_rng((1, done)))[0]
            other = Truth(space, drawn).make_real(
                simulator, episode_steps=task.episode_steps, seed=done
            )
            ranks = space.to_dict(ranks_of(search, other.collect(episodes), drawn).round(4))
            with path.open("a") as lines:
                lines.write(json.dumps(ranks) + "\n")
            done += 1


def ranks_of(
    search: PosteriorSearch, trajectories: list[Trajectory], truth: np.ndarray
) -> np.ndarray:
    """(N,) probabilities, by a world's curves, of being below its truth."""
    _, prob_higher = search.look(trajectories)
    at = 2 * search.searched.to_local(truth) - 1
    grid = candidate_grid()
    curves = zip(at, prob_higher, strict=True)
    return np.array([1 - np.interp(place, grid, curve) for place, curve in curves])


def summary(path: Path) -> dict[str, object]:
    """Worlds, coverage of all and of each parameter's 90 % intervals."""
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    ranks = np.array([list(row.values()) for row in rows])
    inside = (ranks > _INSIDE[0]) & (ranks < _INSIDE[1])
    each = dict(zip(rows[0], inside.mean(0).round(3).tolist(), strict=True))
    histogram = np.histogram(ranks, 10, (0, 1))[0].tolist()
    return {
        "worlds": len(rows),
        "coverage": round(float(inside.mean()), 3),
        "coverage_of_each": each,
        "histogram": histogram,
    }


if __name__ == "__main__":
    tyro.cli(main)
