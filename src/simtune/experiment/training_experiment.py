"""What `train` works with: an experiment, and what learns to act."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from simtune.agents import Agent, Observation
from simtune.config import TrainConfig
from simtune.devices import choose_device
from simtune.errors import InputError
from simtune.experiment.experiment import Experiment, build_search
from simtune.experiment.presets import choose_schedule, choose_search
from simtune.experiment.problem import build_problem
from simtune.experiment.rollout import PolicyWorlds
from simtune.experiment.schedule import Schedule
from simtune.experiment.settings import Settings
from simtune.experiment.training_parts import (
    agent_of,
    check_filmed,
    declared_late_s,
    fixed_range_of,
    policy_worlds_of,
    replay_of,
)
from simtune.networks.layers import under
from simtune.progress import ReportProgress, silent
from simtune.random_streams import Purpose, stream
from simtune.real.recorded import RecordedReal
from simtune.replay_buffer import ReplayBuffer
from simtune.tasks import Task, check_reward, load_task, with_known_colours, with_one_square_camera


@dataclass(frozen=True, kw_only=True)
class TrainingExperiment(Experiment):
    """What `train` works with."""

    config: TrainConfig
    task: Task
    schedule: Schedule
    learnt_in: PolicyWorlds
    scored_in: PolicyWorlds  # with the reality gap, if there is one
    agent: Agent
    replay: ReplayBuffer
    # Steps by which actions are late in the real world that a loaded policy was trained for
    found_delay_steps: int = 0

    @property
    def late_steps(self) -> int:
        """Steps by which actions are late where the policy is scored."""
        gap = self.scored_in.gap
        return gap.delay_steps if gap else self.found_delay_steps

    def score(
        self, world: np.ndarray, num_episodes: int, seed: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """(num_episodes,) of "return" and of goals reached, acting on pixels alone; and a film.

        In a world of (N,) parameters, with the reality gap if there is one, and with actions as
        late as in the real world. A world that diverges is charged the lowest reward of training,
        or of these episodes; training itself is charged nothing for them.
        """
        rng = stream(seed, Purpose.SCORE)
        worlds = np.tile(world, (num_episodes, 1))

        def act(observation: Observation) -> np.ndarray:
            assert observation.frames is not None
            return self.agent.act(observation.frames)

        self.agent.begin_episodes()
        self.scored_in.load(self.learnt_in.state())  # without a gap, they are the same
        played = self.scored_in.play(act, worlds, rng, delay_steps=self.late_steps, counts=False)
        assert played.frames is not None
        assert played.reached is not None
        scores = dict(zip(self.task.goals, played.reached.T, strict=True))
        return {"return": played.rewards.sum(1), **scores}, played.frames[0]

    @property
    def declared_late_steps(self) -> float:
        """Steps by which a policy sees pictures late, as the tuning file declares."""
        return declared_late_s(self) / self.real.step_s

    def delay_steps(self, estimated: float | None, rng: np.random.Generator) -> int:
        """Delay of actions in simulated episodes: about `estimated` steps, or random if None.

        1.3 steps are two in 30 % of the calls, and else one. An oracle knows the reality gap's; a
        simulator as it starts has none, and one with a parameter for the delay no other. A camera's
        declared lateness comes on top: searches see pictures that are put in time.
        """
        late = self.declared_late_steps
        unknown = self.real.observation.unknown_latency_steps(self.simulator)
        if self.config.method == "oracle" and self.scored_in.gap:
            return self.scored_in.gap.delay_steps
        if self.config.method != "untuned" and unknown:
            any_number = int(rng.integers(unknown + 1))
            late += any_number if estimated is None else estimated
        whole, part = divmod(max(0.0, late), 1)
        steps = int(whole) + int(part > 0 and rng.random() < part)
        return min(steps, self.learnt_in.max_delay_steps)

    def policy_warnings(self, num_skipped: int) -> list[str]:
        """Possible problems of the policy, which was too late for `num_skipped` real trials."""
        if not self.agent.can_act:
            return ["the policy had not begun to learn: give more --policy-steps"]
        if num_skipped and not isinstance(self.real, RecordedReal):
            return [
                "the policy had not begun to learn when the real world was to see it: give more "
                "--policy-steps or --pretrain-steps"
            ]
        return []

    def state(self) -> dict[str, Any]:
        return {**super().state(), "policy_worlds": self.learnt_in.state()}

    def load(self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]) -> None:
        super().load(tensors, state)
        self.load_agent(tensors, state)
        film = self.learnt_in.simulator.render  # frames are not stored
        self.replay.load(under("replay/", tensors), state["replay"], film)

    def load_agent(self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]) -> None:
        """To act as it did, and to be scored by the rewards of its training.

        Raises InputError if an earlier version has not stored these.
        """
        if "policy_worlds" not in state:
            raise InputError(
                f"{self.config.out} holds a training of an earlier version of simtune, which this "
                "one cannot go on with or score: train anew, into another folder"
            )
        self.agent.load(under("agent/", tensors), state["agent"])
        self.learnt_in.load(state["policy_worlds"])

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

    `trained`: state of a checkpoint whose agent is loaded, without resuming: no robot is used then,
    and no recording read. Raises InputError for invalid input.
    """
    if trained is None:  # what an earlier version took, and ignored, may be refused now
        config.check()
    task = with_one_square_camera(with_known_colours(load_task(config.task), config.known_colour))
    device, settings = choose_device(config.device), settings or Settings()
    check_reward(task)
    name = choose_search(config)
    schedule = settings.schedule or choose_schedule(config, task, name)
    report("looking at the real world", 0.0)
    num = config.real_episodes if name else 0
    problem = build_problem(config, task, schedule.image_size, num, device, trained=trained)
    check_filmed(config, schedule, problem.real)
    if problem.recordings:  # without a requested number there may be fewer than usual
        later = schedule.real_episodes[1:]
        schedule = replace(schedule, real_episodes=(len(problem.recordings), *later))
    learnt_in, scored_in = policy_worlds_of(config, schedule, task, problem)
    agent = agent_of(config, settings, schedule, learnt_in, problem, device)
    if not agent.needs_keypoints:
        learnt_in.keypoints = None  # finding them in each step takes time
    return TrainingExperiment(
        **vars(problem),
        settings=settings,
        search_name=name,
        search=build_search(problem, name, settings) if name else fixed_range_of(config, problem),
        schedule=schedule,
        learnt_in=learnt_in,
        scored_in=scored_in,
        agent=agent,
        replay=replay_of(schedule, task, device),
    )
