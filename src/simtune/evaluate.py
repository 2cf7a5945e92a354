"""`simtune evaluate`: score a trained policy once more, on other episodes."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from simtune.config import EvaluateConfig, RealConfig, TrainConfig
from simtune.errors import InputError
from simtune.outcome import summary
from simtune.parts import Parts, make_parts
from simtune.progress import ReportProgress, silent
from simtune.real.choose import read_parameters
from simtune.real.closed import ClosedReal
from simtune.run import checkpoint
from simtune.run.config import stored_config
from simtune.tasks import load_task


def evaluate(config: EvaluateConfig, say: ReportProgress = silent) -> dict[str, Any]:
    """Returns of the policy of a run that `train` wrote, in a simulated world; goals by name.

    Nothing is written. Raises InputError where there is no policy, or no world to score it in.
    """
    config.check()
    if _asked(config.run_folder)["real"] != "pseudo" and config.parameters is None:
        raise InputError(
            f"{config.run_folder} is of the real world, where no return is known; give "
            "--parameters of a simulated one"
        )
    parts = trained_parts(config.run_folder, say)
    if config.parameters is not None:
        world = read_parameters(config.parameters, parts.space)
    else:
        assert parts.truth is not None, "of a pseudo-real world"
        world = parts.truth.for_oracle()
    say("scoring the policy", 0.5)
    scores, _ = parts.score(world, config.episodes, config.seed)
    returns = summary(scores.pop("return"))
    return returns | {goal: summary(reached) for goal, reached in scores.items()}


def trained_parts(run_folder: Path, say: ReportProgress = silent) -> Parts:
    """A training's parts, of which the agent is as its newest checkpoint has it.

    Nothing else is: what it learnt from need not be drawn anew, and no robot is asked, no
    recording read. Raises InputError, also where the policy had not begun to learn.
    """
    stored = _asked(run_folder)
    newest = checkpoint.newest(run_folder / "checkpoints")
    if newest is None:
        raise InputError(f"{run_folder} has no sound checkpoint to take a policy from")
    tensors, state = checkpoint.load(newest)
    usual = {f.name: f.default for f in fields(TrainConfig)}
    asked = {name: stored.get(name, default) for name, default in usual.items()}
    former = None
    if stored["real"] != "pseudo":
        asked |= {f.name: usual[f.name] for f in fields(RealConfig) if f.name != "seed"}
        # Which earlier versions did not store
        former = ClosedReal(state.get("step_s") or load_task(asked["task"]).step_s)
    asked["real_parameters"] = asked["real_parameters"] and Path(asked["real_parameters"])
    asked |= {"out": run_folder, "device": "auto"}  # where it is now, and this machine's
    parts = make_parts(TrainConfig(**asked), say, former)
    _check_unchanged(parts, stored, run_folder)
    parts.load_agent(tensors, state)
    if not parts.agent.can_act:
        raise InputError(
            f"{run_folder} has no policy yet, which begins to learn late in a training: go on with "
            "it, or give more --policy-steps"
        )
    return parts


def _check_unchanged(parts: Parts, stored: dict[str, Any], run_folder: Path) -> None:
    """Raises InputError where what the run was asked of is not what its names stand for now."""
    known = stored.get("truth")  # runs of earlier versions know nothing of it
    if known and parts.truth is not None and parts.truth.digest != known:
        raise InputError(
            f"--real-parameters {stored['real_parameters']}, by which {run_folder} was made, has "
            "other values now; put the former back"
        )
    now = {"task_content": parts.task.content_hash, "policy_content": parts.task.policy_hash}
    if any(stored.get(name) != content for name, content in now.items()):
        raise InputError(
            f"{stored['task']}, its model, or what is good there, is not what {run_folder} was "
            "trained with: bring it back, or train anew"
        )


def _asked(run_folder: Path) -> dict[str, Any]:
    """What the training was asked. Raises InputError for what is none."""
    is_run = (run_folder / "config.json").is_file()
    stored = stored_config(run_folder) if is_run else None
    if stored is None or not {"method", "real", "task"} <= stored["config"].keys():
        raise InputError(f"{run_folder} is no folder that `simtune train` wrote")
    return dict(stored["config"])
