"""What a training has beside its search: worlds for the policy, the agent, its replay."""

import math

from simtune.agents import Agent, AgentSpec
from simtune.config import TrainConfig
from simtune.errors import InputError
from simtune.experiment.presets import choose_agent, choose_range
from simtune.experiment.problem import TuningProblem
from simtune.experiment.rollout import PolicyWorlds
from simtune.experiment.schedule import Schedule
from simtune.experiment.settings import Settings
from simtune.randomization import Distribution
from simtune.real import RealWorld
from simtune.real.gap import RealityGap
from simtune.real.robot import RobotReal
from simtune.replay_buffer import ReplayBuffer
from simtune.run.kept import kept_state
from simtune.simulation import Simulator
from simtune.tasks import Task
from simtune.tuning.fixed import FixedRange
from simtune.tuning.readings.horizons import most_latency_steps
from simtune.vision.keypoints import Keypoints

_ROUNDING_STEPS = 1e-6


def policy_worlds_of(
    config: TrainConfig, schedule: Schedule, task: Task, problem: TuningProblem
) -> tuple[PolicyWorlds, PolicyWorlds]:
    """Where the policy learns, and where it is scored: with the reality gap, if there is one."""
    assert isinstance(problem.simulator, Simulator), "load_task gives models' only"
    assert isinstance(problem.keypoints, Keypoints)
    most, seen = _max_delay_steps(problem), problem.real.observation
    learnt_in = PolicyWorlds(
        task,
        problem.simulator,
        schedule.num_stacked,
        problem.keypoints,
        max_delay_steps=most,
        observation=seen,
    )
    gap = RealityGap.of(config, schedule.image_size)
    if not gap:
        return learnt_in, learnt_in
    simulator = gap.simulator(task, seen.views())
    scored_in = PolicyWorlds(task, simulator, schedule.num_stacked, gap=gap, max_delay_steps=most)
    return learnt_in, scored_in


def _max_delay_steps(problem: TuningProblem) -> int:
    """Steps by which actions may be late: by a parameter, or as a search may find them to be.

    And by what a camera declares.
    """
    seen, step_s, space = problem.real.observation, problem.simulator.step_s, problem.space
    declared = math.ceil(declared_late_s(problem) / step_s - _ROUNDING_STEPS)
    if space.is_delay.any():
        return declared + math.ceil(space.high[space.is_delay].max() / step_s - _ROUNDING_STEPS)
    unknown = seen.unknown_latency_steps(problem.simulator)
    by_readings = most_latency_steps(step_s) if unknown and seen.sensors else 0
    return declared + by_readings + unknown


def check_filmed(config: TrainConfig, schedule: Schedule, real: RealWorld) -> None:
    """Raises InputError at once, where a robot may not move, if this training has yet to film it.

    Stored episodes serve its first filming only, and only as random actions: a policy's are filmed
    anew. A checkpoint counts a filming of every cycle, also where the search knew enough for none.
    """
    if config.move or not isinstance(real, RobotReal):
        return
    kept = kept_state(config.out) or {}
    num_done, (first, *later) = kept.get("filmings", 0), schedule.real_episodes
    has_first = num_done or (real.num_filmed >= first and not schedule.pretrain_steps)
    if kept.get("knows_enough") or (has_first and not sum(later[max(num_done - 1, 0) :])):
        return
    whose = " of its policy" if schedule.pretrain_steps else ""
    then = f", and then up to {sum(later)} of its policy" if sum(later) else ""
    hint = " (none with --tried-episodes 0)" if then and not num_done else ""
    raise InputError(
        f"the robot has to move for this: this training needs {first} episodes{whose}{then}{hint}, "
        f"and {real.num_filmed} are filmed: give --move"
    )


def declared_late_s(problem: TuningProblem) -> float:
    """Seconds by which pictures come late to a policy, as the camera's `latency_s` says.

    A pseudo-real world has no such camera: its pictures are in time, and a policy that was trained
    for late ones would be scored in another world.
    """
    if problem.config.real == "pseudo":
        return 0.0
    return sum(camera.footage.latency_s for camera in problem.real.observation.cameras)


def fixed_range_of(config: TrainConfig, problem: TuningProblem) -> FixedRange:
    """The range of a method without a search."""
    mean = problem.start
    if config.method == "oracle":
        assert problem.truth is not None, "checked"
        mean = problem.truth.for_oracle()
    return FixedRange(Distribution.proportional(problem.space, mean, choose_range(config)))


def agent_of(
    config: TrainConfig,
    settings: Settings,
    schedule: Schedule,
    learnt_in: PolicyWorlds,
    problem: TuningProblem,
    device: str,
) -> Agent:
    assert learnt_in.keypoints is not None, "given above"
    spec = AgentSpec(
        image_size=schedule.image_size,
        num_stacked=schedule.num_stacked,
        num_keypoints=len(learnt_in.keypoints),
        num_states=learnt_in.num_states,
        num_positions=learnt_in.num_positions,
        num_actions=learnt_in.simulator.num_actions,
        max_delay_steps=learnt_in.max_delay_steps,
        image_noise=problem.real.observation.image_noise,
        privileged=~learnt_in.task.parameters.is_appearance,
        total_steps=schedule.total_steps,
        steps_before_trial=schedule.steps_before_trial,
        steps_between_updates=schedule.num_worlds * learnt_in.task.episode_steps,
        seed=config.seed,
        device=device,
    )
    return settings.make_agent(choose_agent(config), spec)


def replay_of(schedule: Schedule, task: Task, device: str) -> ReplayBuffer:
    """Room for all episodes, but only for the latest frames."""
    num_episodes = -(-schedule.total_steps // task.episode_steps)
    num_filmed = -(-schedule.filmed_steps // task.episode_steps)
    return ReplayBuffer(
        task.parameters,
        filmed_capacity=min(num_filmed, num_episodes),
        unfilmed_capacity=num_episodes,
        num_stacked=schedule.num_stacked,
        device=device,
    )
