"""Tasks that `simtune tune` does not have, and as a script the command with them.

    python -m whole.variants tune walker_links ...
    python -m whole.variants --quick tune cartpole ...

It is the command itself, with its run folder and its scoring. `--quick` is for the benchmarks' own
`--quick`: a search of seconds, with short episodes, which finds nothing.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from simtune.tasks import TASKS, Task, load_task

_QUICK_STEPS = 24  # of an episode


def _links() -> Task:
    """Walker with one mass each for the torso, the thighs, and the legs with their feet."""
    from honesty import links  # imports torch, which other tasks need later

    return links(load_task("walker"))[1]


VARIANTS: dict[str, Callable[[], Task]] = {"walker_links": _links}


def load(name: str) -> Task:
    """A built-in task or a variant."""
    return VARIANTS[name]() if name in VARIANTS else load_task(name)


def _make_quick() -> None:
    from common import QUICK

    import simtune.tuning_run
    from simtune.before_after.start_search import StartSearchConfig
    from simtune.experiment.settings import Settings

    comparison = StartSearchConfig(num_starts=16, rounds=2)
    settings = Settings(search=replace(QUICK, num_rounds=1), start_search=comparison)
    simtune.tuning_run.tune = partial(simtune.tuning_run.tune, settings=settings)
    for name, make in list(TASKS.items()):
        TASKS[name] = partial(_shortened, make)


def _shortened(make: Callable[[], Task]) -> Task:
    return replace(make(), episode_steps=_QUICK_STEPS)


def main() -> None:
    TASKS.update(VARIANTS)
    if "--quick" in sys.argv:
        sys.argv.remove("--quick")
        _make_quick()
    from simtune.cli import main as simtune_main

    simtune_main()


if __name__ == "__main__":
    main()
