"""One run of benchmarks/accuracy.py: a task, a world, a method, in a process of its own.

As a script it takes one JSON object, the fields of `OneRun` and a core to stay on (or null).
"""

import json
import os
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args
from unittest.mock import patch

import numpy as np

from simtune.config import TuneConfig
from simtune.names import SearchName
from simtune.parameters import ParameterSpace
from simtune.run.files import read_json, write_json

Baseline = Literal["npe", "cmaes", "sysid"]
Method = SearchName | Baseline
SEARCHES, BASELINES = get_args(SearchName), get_args(Baseline)

_NEAR, _FAR = 2.0, 4.0  # factors by which the start is wrong
_DEFAULT_STEPS = 600_000  # about what a posterior search simulates, where none was run


@dataclass(frozen=True, kw_only=True)
class OneRun:
    out: str
    task: str
    world: int  # seeds the truth and everything else
    method: Method
    minutes: float
    real_episodes: int
    gap: bool
    far: bool
    quick: bool = False  # a search of seconds that finds nothing

    @property
    def folder(self) -> Path:
        return Path(self.out) / f"{self.task}-{self.world}-{self.method}"

    @property
    def result(self) -> Path:
        return self.folder / "result.json"


def true_parameters(task: str, space: ParameterSpace, world: int) -> dict[str, float]:
    """A world's truth: dynamics within ×2 and ×½ of nominal, colours in [.25, 1]."""
    rng = np.random.default_rng((zlib.crc32(task.encode()), world))
    factors, colours = 2 ** rng.uniform(-1, 1, len(space)), rng.uniform(0.25, 1, len(space))
    values = np.where(space.is_colour, colours, space.nominal * factors)
    return space.to_dict(space.clip(values))


def carry_out(run: OneRun) -> None:
    """Write the run's result.json."""
    from simtune.tasks import load_task

    truth = run.folder.parent / "truths" / f"{run.task}-{run.world}.json"
    truth.parent.mkdir(parents=True, exist_ok=True)
    write_json(truth, true_parameters(run.task, load_task(run.task).parameters, run.world))
    config = TuneConfig(
        task=run.task,
        out=run.folder,
        real_parameters=truth,
        real_episodes=run.real_episodes,
        search="posterior" if run.method in BASELINES else run.method,
        budget_minutes=run.minutes,
        seed=run.world,
        real_gap=run.gap,
        start_factor=_FAR if run.far else _NEAR,
    )
    if run.method in SEARCHES:
        from common import QUICK

        from simtune.experiment.settings import Settings
        from simtune.tuning_run import tune

        quick = run.quick and run.method == "posterior"
        tune(config, settings=Settings(search=replace(QUICK, num_rounds=1)) if quick else None)
    else:
        _carry_out_baseline(run, config)


def _carry_out_baseline(run: OneRun, config: TuneConfig) -> None:
    from baselines import Problem
    from simtune.randomization import Distribution
    from simtune.real.choose import choose_real
    from simtune.tasks import load_task

    find = import_module(f"baselines.{run.method}").find
    task = load_task(run.task)
    with _watching() as rollouts:
        real, start, truth = choose_real(config, task, 64)
        trajectories = real.collect(run.real_episodes)
    assert truth is not None, "it is a pseudo-real world"
    simulator = task.simulator(  # as tune makes it
        image_size=64, step_s=real.step_s, supersampling=2 if run.gap else 1
    )
    began_s = time.monotonic()
    problem = Problem(
        simulator=simulator,
        real=trajectories,
        first=Distribution.first(task.parameters, start),
        budget_steps=_steps_of_posterior(run),
        deadline_s=began_s + 60 * run.minutes,
        seed=run.world,
        true_states=rollouts[-1].states if run.method == "sysid" else None,
    )
    found = find(problem)
    wall_s = time.monotonic() - began_s
    mean = task.parameters.from_dict(task.parameters.to_dict(start) | found.mean)
    real_values, errors = map(task.parameters.to_dict, truth.score(mean))
    parameters = {
        name: {
            "mean": value,
            "low": found.low[name] if found.low else None,
            "high": found.high[name] if found.high else None,
            "initial": float(start[task.parameters.index(name)]),
            "real": real_values[name],
            "percent_error": errors[name],
        }
        for name, value in found.mean.items()
    }
    facts = {"task": run.task, "method": run.method, "seed": run.world}
    facts |= {"real_episodes": len(trajectories), "sim_steps": simulator.num_steps}
    facts |= {"wall_s": round(wall_s, 1), "parameters": parameters}
    run.folder.mkdir(parents=True, exist_ok=True)
    write_json(run.result, facts)


def _steps_of_posterior(run: OneRun) -> int:
    """What the posterior search simulated in the same world: a baseline's budget."""
    result = OneRun(**{**asdict(run), "method": "posterior"}).result
    return read_json(result)["sim_steps"] if result.exists() else _DEFAULT_STEPS


@contextmanager
def _watching() -> Iterator[list[Any]]:
    """All rollouts played meanwhile: the true states, which no real world would show."""
    from simtune.simulation import Simulator

    played, play = [], Simulator.play

    def watched(self: Simulator, *args: Any, **options: Any) -> Any:
        played.append(play(self, *args, **options))
        return played[-1]

    with patch.object(Simulator, "play", watched):
        yield played


if __name__ == "__main__":
    asked = json.loads(sys.argv[1])
    if (core := asked.pop("core")) is not None:
        os.sched_setaffinity(0, {core})
    carry_out(OneRun(**asked))
