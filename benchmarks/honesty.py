"""Does simtune say so where videos cannot tell, or where no simulator fits?

Worlds made for it. Of cartpole:

    right       nothing is wrong: all is found, nobody is warned (what the others compare with)
    wrong       the real pole is 1.2 times as long, which is not tuned: a warning
    unseeable   the mass of a stone that never moves is asked for: "not identifiable", and an
                interval as wide as the first range
    together    the cart's mass is asked for as well: all masses and the gain go together, so that
                only their ratios are told; their correlations say so

And of others, where several parameters act together:

    spinner     finger: the spinner's damping, beside its mass
    links       walker: one mass for the torso, one for the thighs, one for the legs and feet

One run each. Of each correlated pair it is also said how far off is what is told better: the ratio
where the correlation is positive, else the product. Runs that are done already, in OUT, are not
done again; the last line is one JSON object.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import tyro
from common import QUICK, kept_in, machine, record_figures
from searching import context_of, run_rounds

from simtune.budget import Budget
from simtune.parameters import Parameter, ParameterSpace, dynamics
from simtune.real.truth import Truth
from simtune.run.files import read_json, write_json
from simtune.tasks import Task, load_task
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig

_LONGER = 1.2
_PRECISION = 0.01  # as `simtune tune` asks for by default


def right(task: Task) -> tuple[Task, Task]:
    return task, task


def wrong(task: Task) -> tuple[Task, Task]:
    def longer() -> mujoco.MjSpec:
        spec = task.load_spec()
        pole = spec.geom("pole_1")
        pole.fromto = pole.fromto * _LONGER  # from its hinge, at 0, to its end
        return spec

    return replace(task, load_spec=longer), task


def unseeable(task: Task) -> tuple[Task, Task]:
    def with_stone() -> mujoco.MjSpec:
        spec = task.load_spec()
        stone = spec.worldbody.add_body(name="stone", pos=[1.2, 0, 0.1])
        stone.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], contype=0, conaffinity=0
        )
        return spec

    asked = _asked(task, dynamics("stone_mass", "body_mass", ("stone",), nominal=1.0, unit="kg"))
    return (replace(task, load_spec=with_stone, parameters=asked),) * 2


def together(task: Task) -> tuple[Task, Task]:
    mass_kg = float(task.load_model().body("cart").mass[0])
    asked = _asked(task, dynamics("cart_mass", "body_mass", ("cart",), nominal=mass_kg, unit="kg"))
    return (replace(task, parameters=asked),) * 2


def spinner(task: Task) -> tuple[Task, Task]:
    damping = float(task.load_model().joint("hinge").damping[0])
    asked = dynamics(
        "spinner_damping", "dof_damping", ("hinge",), nominal=damping, unit="N·m·s/rad"
    )
    return (replace(task, parameters=_asked(task, asked)),) * 2


def links(task: Task) -> tuple[Task, Task]:
    of_links = {
        "torso_mass": ("torso",),
        "thighs_mass": ("right_thigh", "left_thigh"),
        "legs_mass": ("right_leg", "left_leg", "right_foot", "left_foot"),
    }
    masses = [dynamics(name, "body_mass", bodies) for name, bodies in of_links.items()]
    others = [p for p in task.parameters if p.name != "mass"]
    return (replace(task, parameters=ParameterSpace([*masses, *others], where=task.name)),) * 2


# Each makes, of a task, the one that is filmed and the one that is tuned.
CASES: dict[Callable[[Task], tuple[Task, Task]], str] = {
    right: "cartpole",
    wrong: "cartpole",
    unseeable: "cartpole",
    together: "cartpole",
    spinner: "finger",
    links: "walker",
}


def main(
    cases: tuple[str, ...] = (),
    minutes: float = 5.0,
    real_episodes: int = 5,
    seed: int = 0,
    out: Path = Path("runs/honesty"),
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Run them all.

    Args:
        cases: Names of those to run; by default all of them.
        minutes: For each.
        real_episodes: Of 200 steps each, with random actions.
        seed: Of everything; it also chooses which parameters start too high.
        out: Folder for what each case found.
        record: Write the figures into this file of docs/results, too.
        quick: One world, no time to learn, nothing kept.
    """
    config, found = PosteriorSearchConfig(precision=_PRECISION), {}
    if quick:
        minutes, real_episodes, config = 0.1, 3, QUICK
    with kept_in(out, quick) as folder:
        chosen = {c: task for c, task in CASES.items() if not cases or c.__name__ in cases}
        for case, name in list(chosen.items())[: 1 if quick else None]:
            path = folder / f"{case.__name__}-{seed}.json"
            if not path.exists():
                print(f"running {path}", file=sys.stderr)
                worlds = case(load_task(name))
                write_json(path, tuned(*worlds, config, minutes, real_episodes, seed))
            found[case.__name__] = read_json(path)
    record_figures(record, ("case",), [row(name, case) for name, case in found.items()])
    print(json.dumps({"benchmark": "honesty", "quick": quick, **machine(), "cases": found}))


def tuned(
    filmed: Task,
    task: Task,
    config: PosteriorSearchConfig,
    minutes: float,
    real_episodes: int,
    seed: int,
) -> dict[str, Any]:
    """What a search makes of videos of `filmed`, its parameters nominal, by tuning `task`."""
    truth, budget = Truth(filmed.parameters, filmed.parameters.nominal), Budget(60 * minutes)
    began_s = time.monotonic()
    world = truth.make_real(
        filmed.simulator(image_size=64), episode_steps=filmed.episode_steps, seed=seed
    )
    real, simulator = world.collect(real_episodes), task.simulator(image_size=64)
    start = truth.wrong_start(seed)
    search = PosteriorSearch(context_of(task, simulator, start, seed), config)
    estimate = run_rounds(search, real, budget)
    real, errors = truth.score(estimate.mean)
    ratios = dict(zip(task.parameters.names, estimate.mean / real, strict=True))
    width = (estimate.high - estimate.low) / (search.first.high - search.first.low)
    told = zip(task.parameters.names, errors, estimate.verdict, width, strict=True)
    return {
        "warnings": estimate.warnings,
        "correlations": {
            pair: {
                "correlation": value,
                "percent_error_together": percent_error_together(pair, value, ratios),
            }
            for pair, value in estimate.correlations.items()
        },
        "parameters": {
            name: {
                "percent_error": round(float(error), 2),
                "verdict": verdict,
                "interval_to_first_range": round(float(share), 3),
            }
            for name, error, verdict, share in told
        },
        "seconds": round(time.monotonic() - began_s, 1),
    }


def row(name: str, found: dict[str, Any]) -> dict[str, Any]:
    """A case as docs/results shows it."""
    parameters = found["parameters"].items()
    verdicts = [f"{parameter} {figures['verdict']}" for parameter, figures in parameters]
    correlated = [f"{pair}: {c['correlation']}" for pair, c in found["correlations"].items()]
    said = [", ".join(found["warnings"]) or "no warning", ", ".join(verdicts), *correlated]
    errors = {parameter: figures["percent_error"] for parameter, figures in parameters}
    return {
        "case": name,
        "said": "; ".join(said),
        "percent_error": errors,
        "wall_s": found["seconds"],
    }


def percent_error_together(pair: str, correlation: float, ratios: dict[str, float]) -> float:
    """How far off is a pair's ratio or product, in percent; `ratios` are found to true."""
    one, other = (ratios[name] for name in pair.split(", "))
    return round(100 * abs(one * other ** -np.sign(correlation) - 1), 2)


def _asked(task: Task, parameter: Parameter) -> ParameterSpace:
    return ParameterSpace([*task.parameters, parameter], where=task.name)


if __name__ == "__main__":
    tyro.cli(main)
