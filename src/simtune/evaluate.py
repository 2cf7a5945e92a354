"""`simtune evaluate`: score a trained policy once more, on other episodes."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from simtune.config import EvaluateConfig, TrainConfig
from simtune.errors import InputError
from simtune.outcome import summary
from simtune.parts import Parts, make_parts
from simtune.progress import Say, silent
from simtune.run import checkpoint
from simtune.run.config import stored_config


def evaluate(config: EvaluateConfig, say: Say = silent) -> dict[str, Any]:
    """Returns of the policy of a run that `train` wrote, in its pseudo-real world; goals by name.

    Nothing is written. Raises InputError where there is no policy, or no world to score it in.
    """
    config.check()
    parts = trained_parts(config.run_folder, say)
    if parts.truth is None:
        raise InputError(f"{config.run_folder} is of the real world, where no return is known")
    say("scoring the policy in the pseudo-real world", 0.5)
    scores, _ = parts.score(config.episodes, config.seed)
    returns = summary(scores.pop("return"))
    return returns | {goal: summary(reached) for goal, reached in scores.items()}


def trained_parts(run_folder: Path, say: Say = silent) -> Parts:
    """A training's parts, of which the agent is as its newest checkpoint has it.

    Nothing else is: what it learnt from need not be drawn anew. Raises InputError.
    """
    is_run = (run_folder / "config.json").is_file()
    stored = stored_config(run_folder) if is_run else None
    if stored is None or "method" not in stored["config"]:
        raise InputError(f"{run_folder} is no folder that `simtune train` wrote")
    newest = checkpoint.newest(run_folder / "checkpoints")
    if newest is None:
        raise InputError(f"{run_folder} has no sound checkpoint to take a policy from")
    asked = {f.name: stored["config"].get(f.name, f.default) for f in fields(TrainConfig)}
    for name in ("out", "real_parameters", "robot"):
        asked[name] = asked[name] and Path(asked[name])
    asked["device"] = "auto"  # this machine's
    parts = make_parts(TrainConfig(**asked), say)
    known = stored["config"].get("truth")  # runs of earlier versions know nothing of it
    if known and parts.truth is not None and parts.truth.digest != known:
        raise InputError(
            f"--real-parameters {asked['real_parameters']}, by which {run_folder} was made, has "
            "other values now; put the former back"
        )
    parts.load_agent(*checkpoint.load(newest))
    return parts
