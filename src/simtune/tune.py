"""`simtune tune`: the parameters alone, without a policy."""

import logging
import time
from dataclasses import asdict
from typing import Any

from simtune import outcome
from simtune.check.recording_warnings import warnings_of
from simtune.comparison import write_comparison
from simtune.config import TuneConfig
from simtune.progress import ReportProgress, silent
from simtune.real.choose import choose_real, simulator_for
from simtune.report import write_report
from simtune.run import RunFolder
from simtune.search_param_model.paper import PaperConfig
from simtune.simulation import AnySimulator
from simtune.tasks import load_any_task
from simtune.trajectory import Trajectory
from simtune.tuning import make_search, needed_image_size
from simtune.tuning.search import Estimate, Search

log = logging.getLogger(__name__)


def tune(config: TuneConfig, say: ReportProgress = silent) -> dict[str, Any]:
    """Find the parameters of a real world; returns the content of result.json.

    A run that was interrupted goes on where its last iteration ended.
    Raises InputError for what cannot be used, with nothing written.
    """
    config.check()
    task = load_any_task(config.task)
    image_size = needed_image_size(config.search)
    say("looking at the real world", 0.0)
    real, start, truth = choose_real(
        config,
        task,
        image_size,
        real_episodes=config.real_episodes,
        real_gap=config.real_gap,
        out=config.out,
    )
    trajectories = real.collect(config.real_episodes)
    simulator = simulator_for(real, task, image_size)
    # Simulated ones need not be longer.
    shortest = min((PaperConfig.episode_steps, *(len(t) for t in trajectories)))
    search = make_search(
        config.search,
        simulator,
        task.camera,
        start,
        config.seed,
        say,
        real.looks_like_simulator,
        None if config.search == "posterior" else PaperConfig(episode_steps=shortest),
    )
    search.check(trajectories)
    doubts = warnings_of(task, real.facts, trajectories, config.search)
    for doubt in doubts:  # now, not after minutes
        log.warning("%s", doubt)
    asked = outcome.asked(config, task, start, real.facts, truth)
    with RunFolder.create(config.out, asked) as run:
        estimate, wall_s = _search(config, run, search, simulator, trajectories, say)
        facts = {
            "task": task.name,
            "method": "regression" if config.search == "regression" else "autotune",
            "search": config.search,
            "seed": config.seed,
            "real": config.real,
            "real_episodes": len(trajectories),
            "step_s": real.step_s,
            "sim_steps": simulator.num_steps,
            "num_diverged": simulator.num_diverged,
            "wall_s": round(wall_s, 1),
            **outcome.recordings(real.facts),
        }
        result = outcome.result(facts, task.parameters, start, estimate, truth)
        result["warnings"] = doubts + result["warnings"]
        run.write_result(result)
        run.write_curves(outcome.curves(estimate))
        say("filming the comparison", 1.0)
        write_comparison(run.videos, simulator, trajectories[0], start, estimate, config.seed)
        write_report(run.path)
    return result


def _search(
    config: TuneConfig,
    run: RunFolder,
    search: Search,
    simulator: AnySimulator,
    real: list[Trajectory],
    say: ReportProgress,
) -> tuple[Estimate, float]:
    """Iterate until nothing is left to gain or the time is over, at least once.

    Returns the last estimate and the seconds spent, over all sittings of the run.
    """
    estimate, iteration, spent_s = None, 0, 0.0
    if checkpoint := run.load_checkpoint():
        tensors, state = checkpoint
        search.load(tensors, state["search"])
        simulator.num_steps, simulator.num_diverged = state["step"], state["num_diverged"]
        estimate = outcome.from_json(state["estimate"])
        iteration, spent_s = state["iteration"], state["wall_s"]
        if search.finished:
            say("the search is over already; another --out searches anew", 1.0)
    began_s = time.monotonic() - spent_s
    deadline_s = began_s + 60 * config.budget_minutes
    while estimate is None or not (search.finished or time.monotonic() >= deadline_s):
        run.drop_result()  # of an earlier sitting: this one goes on
        estimate, events, losses = search.iterate(real, deadline_s)
        iteration += 1
        step, wall_s = simulator.num_steps, time.monotonic() - began_s
        for event in events:
            run.log_event(step, wall_s, **asdict(event))
        scalars = {"iteration": iteration} | outcome.scalars(search, estimate) | losses
        run.log_metrics(step, len(real), wall_s, scalars)
        state = {"iteration": iteration, "step": step, "wall_s": wall_s}
        state["num_diverged"] = simulator.num_diverged
        state |= {"search": search.state(), "estimate": outcome.to_json(estimate)}
        run.save_checkpoint(search.tensors(), state)
    return estimate, time.monotonic() - began_s
