"""What a preset stands for: a schedule, and by name a search and an agent for the task."""

from dataclasses import replace

from simtune.config import TrainConfig
from simtune.errors import InputError
from simtune.experiment.schedule import PAPER_STEPS, SCHEDULES, Schedule
from simtune.names import AgentName, SearchName, search_traits
from simtune.tasks import Task

_AGENTS: dict[str, AgentName] = {"fast": "teacher_student", "paper": "curl_sac"}
_SEARCHES: dict[str, SearchName] = {"fast": "posterior", "paper": "paper"}
_FEW_EPISODES = 5  # real ones at first, as in each update of the authors'


def choose_agent(config: TrainConfig) -> AgentName:
    """Its name, see `agents.AGENTS`."""
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
        many_searches=search_traits(search_name).takes_small_steps,
    )
    if search_name is None:  # real episodes would not be used
        return replace(schedule, real_episodes=(0,) * len(schedule.real_episodes))
    return schedule
