"""Peak resident memory of `simtune tune`, and how it grows with the number of rounds.

A whole run, from the real world's videos to the report, in a process of its own, with all its
worlds and frames but few training updates. The last line is one JSON object.
"""

import json
import resource
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Literal

import tyro
from common import machine, record_figures

# simtune is imported in the measured process only: what this one holds would count there too.

_LIMIT_MB = 4096
_UPDATES = 20  # of each training in a round: memory does not depend on their number


def measure(
    search: str, task: str, moves: int, worlds: int, real_episodes: int, out: Path
) -> list[float]:
    """Run it; the peak resident memory in MiB after each round, and at the end."""
    from simtune.config import TuneConfig
    from simtune.experiment.run import Run
    from simtune.experiment.settings import Settings
    from simtune.search_param_model.paper import PaperConfig
    from simtune.tuning.posterior_config import PosteriorSearchConfig
    from simtune.tuning_run import tune

    if search == "posterior":
        config = PosteriorSearchConfig(
            num_worlds=worlds,
            num_rounds=moves + 1,
            detector_updates=(_UPDATES,),
            posterior_updates=_UPDATES,
        )
    else:
        config = PaperConfig(max_moves=moves, updates_per_episode=1)
    peaks: list[float] = []
    Run.log_round = _then(Run.log_round, lambda: peaks.append(_peak_mb()))
    options = {"task": task, "search": search, "real_episodes": real_episodes, "out": out}
    tune(TuneConfig(**options, budget_minutes=600), settings=Settings(search=config))
    return [*peaks, _peak_mb()]


def _then(call: Callable, also: Callable[[], None]) -> Callable:
    def both(*args):
        result = call(*args)
        also()
        return result

    return both


def _peak_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def main(
    task: str = "ball_in_cup",
    search: Literal["posterior", "paper"] = "posterior",
    moves: int = 5,
    worlds: int = 256,
    real_episodes: int = 10,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        task: One of the built-in tasks.
        search: How it searches.
        moves: Rounds to compare, after those that first take what later ones use again.
        worlds: Simulated in a round of the posterior's search.
        real_episodes: Episodes of the real world.
        record: Write the figures into this file of docs/results, too.
        quick: Fewer moves and worlds: within a minute.
    """
    if moves < 2:
        sys.exit("--moves must be at least 2, to see growth between them")
    if quick:
        moves, worlds, real_episodes = 2, 32, 2
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process,
    ):
        run = process.submit(
            measure, search, task, moves, worlds, real_episodes, Path(folder) / "run"
        )
        *peaks, peak = run.result()
    result = {
        "task": task,
        "search": search,
        "worlds": worlds if search == "posterior" else None,
        "peak_mb": round(peak),
        "limit_mb": _LIMIT_MB,
        "growth_mb": round((peaks[-1] - peaks[-moves]) / (moves - 1), 2),  # a round
        "peaks_mb": [round(p) for p in peaks],  # after each round
        **machine(),
    }
    row = {"what": f"simtune tune {task}, {search}"}
    row |= {name: result[name] for name in ("peak_mb", "peaks_mb")}
    record_figures(record, ("what",), [row])
    print(json.dumps(result))


if __name__ == "__main__":
    tyro.cli(main)
