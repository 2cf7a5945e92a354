"""What a training is made of: the real world, the simulator, the search, the agent."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from simtune.agents import Agent, Seen, make_agent
from simtune.config import SearchName, TrainConfig
from simtune.errors import InputError
from simtune.networks import under
from simtune.parameters import ParameterSpace
from simtune.progress import Say
from simtune.randomization import Distribution
from simtune.real import RealWorld
from simtune.real.choose import choose_real, simulator_for
from simtune.real.recorded import RecordedReal
from simtune.real.truth import Truth
from simtune.replay import Replay
from simtune.rollout import Environment
from simtune.schedule import PAPER_STEPS, PRESETS, Schedule
from simtune.search_param_model.paper import PaperConfig
from simtune.search_param_model.simulated import find_landmarks
from simtune.simulation import Simulator
from simtune.tasks import Task, load_task
from simtune.tuning import FixedRange, make_search
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import Search

_AGENTS = {"fast": "teacher_student", "paper": "curl_sac"}
_SEARCHES: dict[str, SearchName] = {"fast": "posterior", "paper": "paper"}
# Nothing here may end by the clock, or no run could be repeated: less is learnt, but all of it.
_SHORTER = PosteriorSearchConfig(
    num_worlds=192,
    sight_updates=(1500, 1000),
    judge_updates=500,
    state_updates=400,
    replicas=(2, 2),
)


@dataclass(frozen=True)
class Parts:
    task: Task
    schedule: Schedule
    real: RealWorld
    start: np.ndarray  # (N,) where the search begins
    truth: Truth | None  # of a pseudo-real world: it scores, and the oracle lives in it
    environment: Environment
    search: Search
    search_name: str | None
    range_policy: float
    agent: Agent
    replay: Replay

    @property
    def space(self) -> ParameterSpace:
        return self.task.parameters

    def score(self, num_episodes: int, seed: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """(num_episodes,) of "return" and of goals reached, by pixels alone; and a film.

        In the pseudo-real world.
        """
        assert self.truth is not None
        rng = np.random.default_rng((seed, 3))  # episodes that nothing was learnt from
        worlds = np.tile(self.truth.for_oracle(), (num_episodes, 1))

        def act(seen: Seen) -> np.ndarray:
            assert seen.frames is not None
            return self.agent.act(seen.frames)

        played = self.environment.play(act, worlds, rng)
        assert played.frames is not None
        assert played.reached is not None
        scores = dict(zip(self.task.goals, played.reached.T, strict=True))
        return {"return": played.rewards.sum(1), **scores}, played.frames[0]

    def saved(self) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
        """Tensors and JSON of all that changes."""
        tensors = {
            f"{name}/{key}": value
            for name, part in self._changing().items()
            for key, value in part.tensors().items()
        }
        return tensors, {name: part.state() for name, part in self._changing().items()}

    def load(self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]) -> None:
        """The inverse of `saved`."""
        self.load_agent(tensors, state)
        self.search.load(under("search/", tensors), state["search"])
        film = self.environment.simulator.render  # what is stored has no frames
        self.replay.load(under("replay/", tensors), state["replay"], film)

    def load_agent(self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]) -> None:
        """Of all that was `saved` only the agent."""
        self.agent.load(under("agent/", tensors), state["agent"])

    def _changing(self) -> dict[str, Any]:
        return {"agent": self.agent, "search": self.search, "replay": self.replay}


def make_parts(config: TrainConfig, say: Say) -> Parts:
    """All of them. Raises InputError for what cannot be used."""
    config.check()
    task, device = load_task(config.task), _device(config.device)
    if task.reward is None:
        raise InputError(f"{task.name} has no reward, so there is nothing to train a policy for")
    search_name = _search_name(config)
    schedule = _schedule(config, task, search_name)
    say("looking at the real world", 0.0)
    image_size, num_real = schedule.image_size, schedule.real_episodes[0]
    real, start, truth = choose_real(
        config, task, image_size, real_episodes=num_real, out=config.out
    )
    simulator = simulator_for(real, task, image_size)
    assert isinstance(simulator, Simulator), "load_task gives models' only"
    first = Distribution.first(task.parameters, task.parameters.nominal)
    landmarks = find_landmarks(simulator, task.camera, first, seed=0)
    environment = Environment(task, simulator, schedule.num_stacked, landmarks)
    if search_name:
        looks_alike = real.looks_like_simulator
        films = real.collect(num_real) if num_real and isinstance(real, RecordedReal) else []
        shortest = min([task.episode_steps, *(len(film) for film in films)])
        own = _search_config(config, search_name, shortest)
        rest = (config.seed, say, looks_alike, own, device)
        search = make_search(search_name, simulator, task.camera, start, *rest)
        if films:  # a robot, or a policy, films later
            search.check(films)
        range_policy = config.range_policy
    else:
        range_policy = config.range_dr if config.method == "dr" else 0.0
        mean = truth.for_oracle() if truth and config.method == "oracle" else start
        search = FixedRange(Distribution.proportional(task.parameters, mean, range_policy))
    return Parts(
        task=task,
        schedule=schedule,
        real=real,
        start=start,
        truth=truth,
        environment=environment,
        search=search,
        search_name=search_name,
        range_policy=range_policy,
        agent=_agent(config, schedule, environment, len(landmarks), device),
        replay=_replay(schedule, task, device),
    )


def _search_name(config: TrainConfig) -> SearchName | None:
    """None: nothing is searched for."""
    if config.method == "autotune":
        return config.search or _SEARCHES[config.preset]
    return "regression" if config.method == "regression" else None


def _schedule(config: TrainConfig, task: Task, search_name: SearchName | None) -> Schedule:
    usual = PAPER_STEPS if config.preset == "paper" else task.policy_steps
    total_steps = config.policy_steps or usual
    if config.pretrain_steps >= total_steps:
        raise InputError(
            f"--pretrain-steps must be below all {total_steps} policy steps, "
            f"got {config.pretrain_steps}"
        )
    schedule = PRESETS[config.preset](
        total_steps,
        config.real_episodes,
        pretrain_steps=config.pretrain_steps,
        many_searches=search_name in ("paper", "regression"),
    )
    if search_name is None:  # nobody would look at real episodes
        return replace(schedule, real_episodes=(0,) * len(schedule.real_episodes))
    return schedule


def _search_config(
    config: TrainConfig, search_name: SearchName, episode_steps: int
) -> PosteriorSearchConfig | PaperConfig | None:
    """The settings of the search; None: its own."""
    if search_name == "posterior":
        return _SHORTER if config.preset == "fast" else None
    if config.window > episode_steps:
        raise InputError(
            f"--window must be at most an episode's {episode_steps} steps, got {config.window}"
        )
    settings: dict[str, Any] = {"window": config.window, "range_spm": config.range_spm}
    settings |= {"step_size": config.step_size, "episode_steps": episode_steps}
    if config.preset == "fast":  # smaller pictures, and fewer of them before anything moves
        settings |= {"crop_size": 56, "collect_steps": 4000, "pretrain_steps": 0}
        settings |= {"episodes_per_iteration": 5}
    else:  # as `schedule.paper` counts on: 2,000 steps a call, however long an episode is
        settings |= {"collect_steps": 50_000, "pretrain_steps": 50_000}
        settings |= {"episodes_per_iteration": max(1, round(2000 / episode_steps))}
    return PaperConfig(**settings)


def _agent(
    config: TrainConfig,
    schedule: Schedule,
    environment: Environment,
    num_landmarks: int,
    device: str,
) -> Agent:
    return make_agent(
        config.agent or _AGENTS[config.preset],
        image_size=schedule.image_size,
        num_stacked=schedule.num_stacked,
        num_landmarks=num_landmarks,
        num_states=environment.num_states,
        num_positions=environment.num_positions,
        num_actions=environment.simulator.num_actions,
        knows=~environment.task.parameters.is_appearance,
        total_steps=schedule.total_steps,
        first_tried=schedule.first_tried,
        seed=config.seed,
        device=device,
    )


def _replay(schedule: Schedule, task: Task, device: str) -> Replay:
    """Room for all episodes, but for the frames of the latest only."""
    num_episodes = -(-schedule.total_steps // task.episode_steps)
    return Replay(
        task.parameters,
        filmed_capacity=min(schedule.filmed_capacity, num_episodes),
        unfilmed_capacity=num_episodes,
        num_stacked=schedule.num_stacked,
        device=device,
    )


def _device(name: str) -> str:
    """Raises InputError for one that is not there."""
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if name.partition(":")[0] not in ("cpu", "cuda"):
        raise InputError(f"--device must be auto, cpu, cuda or cuda:N, got {name}")
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"--device {name} cannot be used here: {error}") from None
    return name
