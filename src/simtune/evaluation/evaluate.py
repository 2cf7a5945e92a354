"""`simtune evaluate`: score a run once more, on other episodes."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from simtune.config import EvaluateConfig, TrainConfig
from simtune.errors import InputError
from simtune.evaluation.replay import evaluate_replay
from simtune.experiment.outcome import mean_and_spread
from simtune.experiment.settings import Settings
from simtune.experiment.training_experiment import TrainingExperiment, build_training
from simtune.parameters.values_file import read_parameters
from simtune.run import checkpoint
from simtune.run.config import check_names_task, option_defaults, stored_config
from simtune.run.sources import other_readers, source_of
from simtune.tuning.estimate import Estimate

_OPTIONS = [field.name for field in fields(TrainConfig)]
_EPISODES = 20
_NONE = "is no folder that `simtune train` wrote"
_REPLAYED = (
    "is of `simtune tune` and has no policy to score: give --real RECORDINGS "
    "with readings of its tuning file's [[sensors]], which are replayed"
)
_PATHS = ("robot", "real_parameters")  # options that config.json stores as text


def evaluate(config: EvaluateConfig, settings: Settings | None = None) -> dict[str, Any]:
    """Returns of the policy of a run that `train` wrote, in a simulated world; goals by name.

    With `config.real`, how well those recordings are replayed instead: see `evaluate_replay`.

    Nothing is written. Raises InputError if there is no policy, or no world to score it in.
    """
    config.check()
    if config.real is not None:
        return evaluate_replay(config.run_folder, config.real, config.episodes)
    stored = _stored(config.run_folder, if_tuned=_REPLAYED)
    if stored["config"]["real"] != "pseudo" and config.parameters is None:
        raise InputError(
            f"{config.run_folder} is of the real world, where no return is known; give "
            "--parameters of a simulated one"
        )
    trained = load_trained(config.run_folder, settings)
    if config.parameters is not None:
        world = read_parameters(config.parameters, trained.space)
    else:
        assert trained.truth is not None, "of a pseudo-real world"
        world = trained.truth.for_oracle()
    scores, _ = trained.score(world, config.episodes or _EPISODES, config.seed)
    returns = mean_and_spread(scores.pop("return"))
    return returns | {goal: mean_and_spread(reached) for goal, reached in scores.items()}


def load_trained(run_folder: Path, settings: Settings | None = None) -> TrainingExperiment:
    """A training whose agent is loaded from its newest checkpoint.

    Nothing else is loaded: replays are not drawn anew, no robot is used, no recording read. Raises
    InputError, also if the policy had not begun to learn.
    """
    stored = _stored(run_folder)
    run_config = stored["config"]
    newest = checkpoint.newest(run_folder / "checkpoints")
    if newest is None:
        raise InputError(f"{run_folder} has no sound checkpoint to take a policy from")
    tensors, state = checkpoint.load(newest)
    options = {name: run_config[name] for name in _OPTIONS}
    for name in ("task", "real_parameters"):
        if options[name] is not None:  # the copy that the run keeps
            options[name] = source_of(run_folder, stored, options[name])
    options |= {name: Path(options[name]) for name in _PATHS if options[name] is not None}
    options |= {"out": run_folder, "device": "auto"}  # its present folder, this machine
    trained = build_training(TrainConfig(**options), settings=settings, trained=state)
    _check_unchanged(trained, stored, run_folder)
    trained.load_agent(tensors, state)
    if run_config["real"] != "pseudo":
        found = Estimate.from_json(state["estimate"])
        late = round(found.late_steps(trained.real.step_s) + trained.declared_late_steps)
        most = trained.learnt_in.max_delay_steps
        trained = replace(trained, found_delay_steps=min(max(0, late), most))
    if not trained.agent.can_act:
        raise InputError(f"{run_folder} has no policy yet: {_what_would_make_one(run_folder)}")
    return trained


def _what_would_make_one(run_folder: Path) -> str:
    """What to do for a policy, which begins to learn late in a training."""
    if (run_folder / "result.json").is_file():
        return "its training is finished, and was too short; train anew with more --policy-steps"
    return "its training is not finished; the same command goes on with it"


def _check_unchanged(trained: TrainingExperiment, stored: dict[str, Any], run_folder: Path) -> None:
    """Raises InputError if names in a run's options refer to something else now."""
    run_config = stored["config"]
    if trained.truth is not None and trained.truth.digest != run_config["truth"]:
        raise InputError(
            f"--real-parameters {run_config['real_parameters']}, by which {run_folder} was made, "
            "has other values now; put the former back"
        )
    task = trained.task
    now = {"task_content": task.content_hash, "policy_content": task.policy_hash}
    if all(run_config[name] == content for name, content in now.items()):
        return
    source = run_config["task"]
    if readers := other_readers(run_folder, stored):
        raise InputError(
            f"{source} is read otherwise than when {run_folder} was trained ({readers}): go back "
            "to the former versions, or train anew"
        )
    raise InputError(
        f"{source}, its model, or what is good there, is not what {run_folder} was trained with: "
        "bring it back, or train anew"
    )


def _stored(run_folder: Path, if_tuned: str = _NONE) -> dict[str, Any]:
    """config.json of a training, with defaults of options that its version did not have.

    Raises InputError if there is none; `if_tuned` says so of a run of `tune`.
    """
    is_run = (run_folder / "config.json").is_file()
    stored = stored_config(run_folder) if is_run else None
    if stored is None or "method" not in stored["config"]:
        is_tuned = stored is not None and "task" in stored["config"]
        raise InputError(f"{run_folder} {if_tuned if is_tuned else _NONE}")
    check_names_task(run_folder, stored["config"])
    return stored | {"config": option_defaults(TrainConfig) | stored["config"]}
