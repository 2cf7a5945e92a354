"""What a preset stands for: a schedule, a search and an agent for the task."""

from collections.abc import Sequence
from dataclasses import replace

from simtune.config import TrainConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.schedule import PAPER_STEPS, SCHEDULES, Schedule
from simtune.fit import FitConfig
from simtune.names import SearchName
from simtune.networks.pixel_encoder import crop_of
from simtune.search_param_model.paper import PaperConfig
from simtune.tasks import AnyTask, Task
from simtune.trajectory import Trajectory
from simtune.tuning.policy_range import WIDER
from simtune.tuning.posterior_config import PosteriorSearchConfig

_AGENTS = {"fast": "teacher_student", "paper": "curl_sac"}
_SEARCHES: dict[str, SearchName] = {"fast": "posterior", "paper": "paper"}
_FEW_EPISODES = 5  # real ones at first, as in each update of the authors'
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


def choose_agent(config: TrainConfig) -> str:
    """Its name, see `agents.make_agent`."""
    return config.agent or _AGENTS[config.preset]


def choose_search(config: TrainConfig) -> SearchName | None:
    """Its name; None: no search."""
    if config.method == "autotune":
        return config.search or _SEARCHES[config.preset]
    return "regression" if config.method == "regression" else None


def choose_range(config: TrainConfig) -> float:
    """Half-width of Ξ_policy relative to its mean."""
    own = {"dr": config.range_dr, "untuned": 0.0, "oracle": 0.0}
    return own.get(config.method, config.range_policy)


def choose_schedule(config: TrainConfig, task: Task, search_name: SearchName | None) -> Schedule:
    """Raises InputError if nothing is left after pretraining."""
    usual = PAPER_STEPS if config.preset == "paper" else task.policy_steps
    total_steps = config.policy_steps or usual
    if config.pretrain_steps >= total_steps:
        raise InputError(
            f"--pretrain-steps must be below all {total_steps} policy steps, "
            f"got {config.pretrain_steps}"
        )
    schedule = SCHEDULES[config.preset](
        total_steps,
        config.real_episodes or _FEW_EPISODES,
        config.tried_episodes,
        pretrain_steps=config.pretrain_steps,
        many_searches=search_name in ("paper", "regression"),
    )
    if search_name is None:  # real episodes would not be used
        return replace(schedule, real_episodes=(0,) * len(schedule.real_episodes))
    return schedule


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


def choose_search_settings(
    config: TuneConfig | TrainConfig,
    search_name: SearchName,
    task: AnyTask,
    recordings: Sequence[Trajectory],
    image_size: int,
) -> PosteriorSearchConfig | PaperConfig:
    """The search's settings, for pictures of `image_size` pixels.

    Raises InputError for too long a window.
    """
    if search_name == "posterior":
        if isinstance(config, TuneConfig):
            return PosteriorSearchConfig(precision=config.relative_precision)
        assert isinstance(task, Task), "a policy needs a reward"
        return _search_of_training(config, task)
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
