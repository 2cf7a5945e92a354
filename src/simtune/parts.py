"""What a training is made of: the real world, the simulator, the search, the agent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from simtune.agents import Agent, AgentSpec, Observation, make_agent
from simtune.check.recording_warnings import warnings_of
from simtune.config import TrainConfig
from simtune.errors import InputError
from simtune.networks import under
from simtune.parameters import ParameterSpace
from simtune.presets import choose_agent, choose_schedule, choose_search, choose_search_config
from simtune.progress import ReportProgress
from simtune.randomization import Distribution
from simtune.real import RealWorld
from simtune.real.choose import choose_real, simulator_for
from simtune.real.closed import ClosedReal
from simtune.real.recorded import RecordedReal
from simtune.real.truth import Truth
from simtune.replay import Replay
from simtune.rollout import Environment
from simtune.schedule import Schedule
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory
from simtune.tuning import FixedRange, make_search
from simtune.tuning.search import Search
from simtune.vision.keypoints import find_keypoints


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

    def score(
        self, world: np.ndarray, num_episodes: int, seed: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """(num_episodes,) of "return" and of goals reached, by pixels alone; and a film.

        In a world of (N,) parameters.
        """
        rng = np.random.default_rng((seed, 3))  # episodes that nothing was learnt from
        worlds = np.tile(world, (num_episodes, 1))

        def act(observation: Observation) -> np.ndarray:
            assert observation.frames is not None
            return self.agent.act(observation.frames)

        played = self.environment.play(act, worlds, rng)
        assert played.frames is not None
        assert played.reached is not None
        scores = dict(zip(self.task.goals, played.reached.T, strict=True))
        return {"return": played.rewards.sum(1), **scores}, played.frames[0]

    def doubts(self, films: Sequence[Trajectory], num_untried: int) -> list[str]:
        """What may be wrong with what was learnt, after so many looks without a policy to try."""
        found = warnings_of(self.task, self.real.facts, films, self.search_name)
        if not self.agent.can_act:
            found.append("the policy had not begun to learn: give more --policy-steps")
        elif num_untried and not isinstance(self.real, RecordedReal):
            found.append(
                "the policy had not begun to learn when the real world was to see it: give more "
                "--policy-steps or --pretrain-steps"
            )
        return found

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


def make_parts(config: TrainConfig, say: ReportProgress, former: ClosedReal | None = None) -> Parts:
    """All of them; a `former` real world stands for one that is to be left alone.

    Raises InputError for what cannot be used.
    """
    config.check()
    task, device = load_task(config.task), _device(config.device)
    if task.reward is None:
        raise InputError(
            f"{task.name} has no reward, so there is nothing to train a policy for: declare one "
            "in the tuning file's [policy] (docs/tuning-file.md)"
        )
    search_name = choose_search(config)
    schedule = choose_schedule(config, task, search_name)
    say("looking at the real world", 0.0)
    image_size = schedule.image_size
    # Recordings are read at once. Where none are asked for, there may be fewer than the usual.
    num_read = config.real_episodes if search_name else 0
    real, start, truth = (
        (former, task.parameters.nominal.copy(), None)
        if former
        else choose_real(config, task, image_size, real_episodes=num_read, out=config.out)
    )
    simulator = simulator_for(real, task, image_size)
    first = Distribution.first(task.parameters, task.parameters.nominal)
    keypoints = find_keypoints(simulator, task.camera, first, seed=0)
    environment = Environment(task, simulator, schedule.num_stacked, keypoints)
    if search_name:
        range_policy = config.range_policy
        # A robot, or a policy, films later.
        films = real.collect(num_read) if isinstance(real, RecordedReal) else []
        shortest = min([task.episode_steps, *(len(film) for film in films)])
        settings = choose_search_config(config, search_name, shortest)
        rest = (config.seed, say, real.looks_like_simulator, settings, device)
        search = make_search(search_name, simulator, task.camera, start, *rest)
        if films:
            search.check(films)
            later = schedule.real_episodes[1:]
            schedule = replace(schedule, real_episodes=(len(films), *later))
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
        agent=_agent(config, schedule, environment, len(keypoints), device),
        replay=_replay(schedule, task, device),
    )


def _agent(
    config: TrainConfig,
    schedule: Schedule,
    environment: Environment,
    num_keypoints: int,
    device: str,
) -> Agent:
    spec = AgentSpec(
        image_size=schedule.image_size,
        num_stacked=schedule.num_stacked,
        num_keypoints=num_keypoints,
        num_states=environment.num_states,
        num_positions=environment.num_positions,
        num_actions=environment.simulator.num_actions,
        privileged=~environment.task.parameters.is_appearance,
        total_steps=schedule.total_steps,
        first_tried=schedule.first_tried,
        round_steps=schedule.num_worlds * environment.task.episode_steps,
        seed=config.seed,
        device=device,
    )
    return make_agent(choose_agent(config), spec)


def _replay(schedule: Schedule, task: Task, device: str) -> Replay:
    """Room for all episodes, but for the frames of the latest only."""
    num_episodes = -(-schedule.total_steps // task.episode_steps)
    num_filmed = -(-schedule.filmed_steps // task.episode_steps)
    return Replay(
        task.parameters,
        filmed_capacity=min(num_filmed, num_episodes),
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
