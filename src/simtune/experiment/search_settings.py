"""Searches by their names, and their settings, as options and presets choose them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import assert_never

from simtune.config import TrainConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.presets import choose_agent, choose_schedule
from simtune.fit import FitConfig
from simtune.names import SearchName
from simtune.networks.pixel_encoder import crop_of
from simtune.search_param_model.paper import PaperConfig
from simtune.tasks import AnyTask, Task
from simtune.trajectory import Trajectory
from simtune.tuning.paper import PaperSearch
from simtune.tuning.policy_range import WIDER
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import Search, SearchContext

SearchSettings = PosteriorSearchConfig | PaperConfig

# Nothing here may end by the clock, or no run could be repeated: less is learnt, but always all.
_FAST_SEARCH = PosteriorSearchConfig(
    for_policy=True,
    num_rounds=2,
    num_worlds=128,
    detector_updates=(1000, 1500),
    posterior_updates=300,
    state_updates=300,
    fit=FitConfig().at_most(32, 45),
    planned_refits=2,
    most_refits=2,
)


def make_search(name: SearchName, context: SearchContext, settings: SearchSettings) -> Search:
    """A search that starts at `context.start`; `settings` must be of its own kind.

    Raises InputError for an environment with a window-based search, whose frames are drawn anew
    when a run resumes, and if nothing moves that could show a hidden parameter.
    """
    match name:
        case "posterior":
            assert isinstance(settings, PosteriorSearchConfig)
            return PosteriorSearch(context, settings)
        case "paper" | "regression":
            assert isinstance(settings, PaperConfig)
            return PaperSearch(context, settings, method=name)
        case _:
            assert_never(name)


def choose_search_settings(
    config: TuneConfig | TrainConfig,
    search_name: SearchName,
    task: AnyTask,
    recordings: Sequence[Trajectory],
    image_size: int,
) -> SearchSettings:
    """The search's settings, for pictures of `image_size` pixels.

    Raises InputError for too long a window.
    """
    match search_name:
        case "posterior":
            if isinstance(config, TuneConfig):
                return PosteriorSearchConfig(precision=config.relative_precision)
            assert isinstance(task, Task), "a policy needs a reward"
            return _search_of_training(config, task)
        case "paper" | "regression":
            return _paper_search(config, search_name, task, recordings, image_size)
        case _:
            assert_never(search_name)


def _paper_search(
    config: TuneConfig | TrainConfig,
    search_name: SearchName,
    task: AnyTask,
    recordings: Sequence[Trajectory],
    image_size: int,
) -> PaperConfig:
    # Simulated episodes need not be longer than recorded ones.
    is_training = isinstance(config, TrainConfig)
    longest = task.episode_steps if is_training else PaperConfig.episode_steps
    usual = PaperConfig(
        crop_size=min(PaperConfig.crop_size, crop_of(image_size)),
        episode_steps=min([longest, *map(len, recordings)]),
    )
    if not is_training:
        return usual
    assert isinstance(task, Task), "a policy needs a reward"
    return _paper_search_of_training(config, search_name, task, usual)


def _search_of_training(config: TrainConfig, task: Task) -> PosteriorSearchConfig:
    if config.preset == "fast":
        return replace(
            _FAST_SEARCH,
            precision=config.range_policy / WIDER,  # of wider ones, Ξ_policy would hold less
            tolerates_brightness=choose_agent(config) == "teacher_student",
        )
    # The last round is judged by known worlds, so none may be planned that does not come.
    come = sum(choose_schedule(config, task, "posterior").searches)
    return PosteriorSearchConfig(num_rounds=min(PosteriorSearchConfig.num_rounds, come))


def _paper_search_of_training(
    config: TrainConfig, search_name: SearchName, task: Task, usual: PaperConfig
) -> PaperConfig:
    """The paper's search, or regression, in a training. Raises InputError for too long a window."""
    steps = usual.episode_steps
    if config.window > steps:
        raise InputError(
            f"--window must be at most an episode's {steps} steps, got {config.window}"
        )
    planned = sum(choose_schedule(config, task, search_name).searches)
    usual = replace(
        usual,
        window=config.window,
        range_spm=config.range_spm,
        step_size=config.step_size,
        max_moves=max(PaperConfig.max_moves, planned),  # the schedule ends a training
    )
    if config.preset == "fast":  # fewer pictures before the first move
        return replace(usual, collect_steps=4000, pretrain_steps=0, episodes_per_iteration=5)
    # as `schedule.paper` assumes: 2,000 steps a call, for any length of episodes
    per_call = max(1, round(2000 / steps))
    return replace(
        usual, collect_steps=50_000, pretrain_steps=50_000, episodes_per_iteration=per_call
    )
