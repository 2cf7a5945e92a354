"""What a training is made of besides: the schedule, the environment, the agent, its replay."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from simtune import outcome
from simtune.agents import Agent, Seen
from simtune.config import TrainConfig
from simtune.errors import InputError
from simtune.experiment.experiment import Experiment, build_context, stored_keypoints
from simtune.experiment.settings import Settings
from simtune.names import SearchName
from simtune.networks import under
from simtune.presets import (
    choose_agent,
    choose_range,
    choose_schedule,
    choose_search,
    choose_search_settings,
)
from simtune.progress import ReportProgress, silent
from simtune.randomization import Distribution
from simtune.real import RealWorld
from simtune.real.choose import choose_real
from simtune.real.closed import ClosedReal
from simtune.real.recorded import RecordedReal
from simtune.real.truth import Truth
from simtune.replay import Replay
from simtune.rollout import Environment
from simtune.schedule import Schedule
from simtune.simulation import Simulator
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory
from simtune.tuning import FixedRange, SearchContext, make_search
from simtune.tuning.search import Search
from simtune.vision.keypoints import Keypoints


@dataclass(frozen=True, kw_only=True)
class TrainingExperiment(Experiment):
    """What `train` works with."""

    config: TrainConfig
    task: Task
    schedule: Schedule
    environment: Environment
    agent: Agent
    replay: Replay

    @property
    def range_policy(self) -> float:
        """Half-width of the worlds that the policy is trained in, relative to their mean."""
        return choose_range(self.config)

    def score(
        self, world: np.ndarray, num_episodes: int, seed: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """(num_episodes,) of "return" and of goals reached, by pixels alone; and a film.

        In a world of (N,) parameters.
        """
        rng = np.random.default_rng((seed, 3))  # episodes that nothing was learnt from
        worlds = np.tile(world, (num_episodes, 1))

        def act(seen: Seen) -> np.ndarray:
            assert seen.frames is not None
            return self.agent.act(seen.frames)

        played = self.environment.play(act, worlds, rng)
        assert played.frames is not None
        assert played.reached is not None
        scores = dict(zip(self.task.goals, played.reached.T, strict=True))
        return {"return": played.rewards.sum(1), **scores}, played.frames[0]

    def policy_warnings(self, num_skipped: int) -> list[str]:
        """What may be wrong with the policy, which came too late for `num_skipped` real trials."""
        if not self.agent.is_ready:
            return ["the policy had not begun to learn: give more --policy-steps"]
        if num_skipped and not isinstance(self.real, RecordedReal):
            return [
                "the policy had not begun to learn when the real world was to see it: give more "
                "--policy-steps or --pretrain-steps"
            ]
        return []

    def load(self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]) -> None:
        super().load(tensors, state)
        self.load_agent(tensors, state)
        film = self.environment.simulator.render  # what is stored has no frames
        self.replay.load(under("replay/", tensors), state["replay"], film)

    def load_agent(self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]) -> None:
        """The agent alone, to act as it did."""
        self.agent.load(under("agent/", tensors), state["agent"])

    def _changing(self) -> dict[str, Any]:
        return {**super()._changing(), "agent": self.agent, "replay": self.replay}


def build_training(
    config: TrainConfig,
    report: ReportProgress = silent,
    settings: Settings | None = None,
    *,
    trained: Mapping[str, Any] | None = None,
) -> TrainingExperiment:
    """What `train` works with.

    `trained`: the state of a checkpoint whose agent is to be loaded, and nothing to go on: no
    robot is asked then, and no recording read. Raises InputError for what cannot be used.
    """
    config.check()
    task, device, settings = load_task(config.task), _device(config.device), settings or Settings()
    if task.reward is None:
        raise InputError(
            f"{task.name} has no reward, so there is nothing to train a policy for: declare one "
            "in the tuning file's [policy] (docs/tuning-file.md)"
        )
    search_name = choose_search(config)
    schedule = settings.schedule or choose_schedule(config, task, search_name)
    report("looking at the real world", 0.0)
    real, start, truth = _real_world(config, task, schedule, search_name, trained)
    # A robot, or a policy, films later.
    is_read = search_name is not None and isinstance(real, RecordedReal)
    recordings = real.collect(config.real_episodes) if is_read else []
    if recordings:  # where no number is asked for, there may be fewer than the usual
        later = schedule.real_episodes[1:]
        schedule = replace(schedule, real_episodes=(len(recordings), *later))
    run_config = outcome.run_config(config, task, start, real.facts, truth)
    keypoints = trained["keypoints"] if trained else stored_keypoints(config.out, run_config)
    context = build_context(
        config, task, real, start, schedule.image_size, device=device, keypoints=keypoints
    )
    environment = _environment(task, schedule, context)
    return TrainingExperiment(
        config=config,
        settings=settings,
        run_config=run_config,
        task=task,
        real=real,
        recordings=recordings,
        truth=truth,
        context=context,
        search_name=search_name,
        search=_search(config, settings, task, context, recordings, truth),
        schedule=schedule,
        environment=environment,
        agent=_agent(config, settings, schedule, environment, device),
        replay=_replay(schedule, task, device),
    )


def _real_world(
    config: TrainConfig,
    task: Task,
    schedule: Schedule,
    search_name: SearchName | None,
    trained: Mapping[str, Any] | None,
) -> tuple[RealWorld, np.ndarray, Truth | None]:
    """See `choose_real`; a real world that a camera filmed is left alone by what is `trained`."""
    if trained and config.real != "pseudo":
        return ClosedReal(trained["step_s"]), task.parameters.nominal.copy(), None
    num_read = config.real_episodes if search_name else 0
    return choose_real(config, task, schedule.image_size, real_episodes=num_read, out=config.out)


def _environment(task: Task, schedule: Schedule, context: SearchContext) -> Environment:
    simulator, keypoints = context.simulator, context.keypoints
    assert isinstance(simulator, Simulator), "load_task gives models' only"
    assert isinstance(keypoints, Keypoints)
    return Environment(task, simulator, schedule.num_stacked, keypoints)


def _search(
    config: TrainConfig,
    settings: Settings,
    task: Task,
    context: SearchContext,
    recordings: list[Trajectory],
    truth: Truth | None,
) -> Search:
    """The search that the method asks for. Raises InputError where recordings do not suit it."""
    if search_name := choose_search(config):
        shortest = min([task.episode_steps, *map(len, recordings)])
        usual = choose_search_settings(config, search_name, shortest)
        search = make_search(search_name, context, settings.search or usual)
        if recordings:
            search.check(recordings)
        return search
    mean = truth.for_oracle() if truth and config.method == "oracle" else context.start
    return FixedRange(Distribution.proportional(task.parameters, mean, choose_range(config)))


def _agent(
    config: TrainConfig,
    settings: Settings,
    schedule: Schedule,
    environment: Environment,
    device: str,
) -> Agent:
    assert environment.keypoints is not None, "given above"
    return settings.make_agent(
        choose_agent(config),
        image_size=schedule.image_size,
        num_stacked=schedule.num_stacked,
        num_keypoints=len(environment.keypoints),
        num_states=environment.num_states,
        num_positions=environment.num_positions,
        num_actions=environment.simulator.num_actions,
        knows=~environment.task.parameters.is_appearance,
        total_steps=schedule.total_steps,
        first_tried=schedule.first_tried,
        round_steps=schedule.num_worlds * environment.task.episode_steps,
        seed=config.seed,
        device=device,
    )


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
