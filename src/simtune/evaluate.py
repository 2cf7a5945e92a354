"""`simtune evaluate`: score a trained policy once more, on other episodes."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from simtune.config import EvaluateConfig, TrainConfig
from simtune.errors import InputError
from simtune.parts import make_parts
from simtune.progress import Say, silent
from simtune.run import checkpoint
from simtune.run.config import stored_config


def evaluate(config: EvaluateConfig, say: Say = silent) -> dict[str, Any]:
    """Returns of the policy of a run that `train` wrote, in its pseudo-real world.

    Nothing is written. Raises InputError where there is no policy, or no world to score it in.
    """
    config.check()
    trained = _trained(config.run_folder)
    newest = checkpoint.newest(config.run_folder / "checkpoints")
    if newest is None:
        raise InputError(f"{config.run_folder} has no sound checkpoint to take a policy from")
    parts = make_parts(trained, say)
    if parts.truth is None:
        raise InputError(f"{config.run_folder} is of recordings, in which no policy can be tried")
    parts.load(*checkpoint.load(newest))
    say("scoring the policy in the pseudo-real world", 0.5)
    returns, _ = parts.score(config.episodes, config.seed)
    return {"mean": float(returns.mean()), "std": float(returns.std()), "episodes": len(returns)}


def _trained(run_folder: Path) -> TrainConfig:
    """What `train` was asked for there."""
    stored = stored_config(run_folder)
    if stored is None or "method" not in stored["config"]:
        raise InputError(f"{run_folder} is no folder that `simtune train` wrote")
    asked = {f.name: stored["config"].get(f.name, f.default) for f in fields(TrainConfig)}
    for name in ("out", "real_parameters"):
        asked[name] = asked[name] and Path(asked[name])
    return TrainConfig(**asked)
