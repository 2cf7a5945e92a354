"""Algorithm 1 of the paper, top to bottom: learn to act while the simulator is tuned.

Initialize D_policy, agent, D_sp, SPM q_φ                 build_training
Initialize simulator with Ξ⁰                              build_training
Fill D_sp from a random policy, pretrain q_φ              _film_real_world, _update_simulator
for step k
    policy training phase                                 _train_policy
    sim param training phase                              _update_simulator
    update simulation from real                           _film_real_world, _update_simulator

The last three form a loop; here a cycle begins with the real world, since the first, random one
must begin there. The parts are in `experiment/`, their numbers in its `schedule.py`.
"""

import time
from functools import partial
from typing import Any

import numpy as np

from simtune.budget import Budget
from simtune.config import TrainConfig
from simtune.experiment import outcome
from simtune.experiment.presets import choose_range
from simtune.experiment.run import Run
from simtune.experiment.settings import Settings
from simtune.experiment.training_experiment import TrainingExperiment, build_training
from simtune.names import search_traits
from simtune.progress import ReportProgress, silent, told
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.real.truth import Truth
from simtune.recordings import write_video
from simtune.run.real_episodes import read_real, write_real
from simtune.trajectory import Trajectory
from simtune.tuning.policy_range import policy_range


def train(
    config: TrainConfig,
    report: ReportProgress = silent,
    settings: Settings | None = None,
    *,
    command: str | None = None,
) -> dict[str, Any]:
    """Carry out Algorithm 1; returns the content of result.json.

    An interrupted run resumes from its last checkpoint, to the same result. `command`: what the
    user typed, to be stored. Raises InputError for invalid input, with nothing written, and
    RuntimeError for what fails on the way.
    """
    began_s = time.monotonic()
    experiment = build_training(config, report, settings)
    warnings = told(experiment.warnings(experiment.recordings) + experiment.film_warnings())
    with Run(experiment, report, began_s) as run:
        training = Training(experiment, run, report)
        training.resume()
        run.folder.write_config()
        training.carry_out()
        return training.finish(warnings, command)


class Training:
    """State of Algorithm 1. Its counters only grow, so that it can resume at any of them."""

    def __init__(self, experiment: TrainingExperiment, run: Run, report: ReportProgress = silent):
        self.experiment, self.run, self._report = experiment, run, report
        self.real: list[Trajectory] = []  # all real episodes, the latest first
        self.num_filmings = 0  # of the real world, one per cycle
        self.num_skipped = 0  # of them, without a policy that could act
        self.num_scored = 0  # cycles after which the policy was scored
        self.rng = stream(experiment.config.seed, Purpose.TRAINING)
        self._saved_s = time.monotonic()

    def carry_out(self) -> None:
        """Algorithm 1."""
        schedule = self.experiment.schedule
        run = self.run
        # Sim-to-real (Sec. VI-B): first a policy by domain randomisation around the start
        while run.step < schedule.pretrain_steps:
            self._train_policy()
        for cycle in range(len(schedule.policy_steps)):
            # Collect samples by running π_θ in the real world; at first, by random actions
            if self.num_filmings <= cycle:
                self._film_real_world()
            # Collect simulated trajectories, train q_φ, Ξ ← Ξ + α q_φ(o_real, a_real, ξ_mean)
            while run.num_rounds < sum(schedule.searches[: cycle + 1]) and not self._knows_enough:
                self._update_simulator()
            # At each reset, sample ξ_sim ~ Ξ_policy; collect in D_policy, train π_θ
            while run.step < schedule.steps_after(cycle):
                self._train_policy()
            if self.num_scored <= cycle < len(schedule.policy_steps) - 1:
                self._score_meanwhile()
        self._save()

    @property
    def _knows_enough(self) -> bool:
        """Whether another round of the search would change nothing for the policy."""
        return bool(self.run.num_rounds and self.experiment.search.stop_reason)

    def _film_real_world(self) -> None:
        filmed = [] if self._knows_enough else self._collect_real()
        write_real(self.run.folder.path, self.num_filmings, filmed)
        self.real = filmed + self.real
        self.num_filmings += 1
        self._save()

    def _collect_real(self) -> list[Trajectory]:
        """A cycle's episodes of π_θ; the first ones by random actions, or recordings."""
        real = self.experiment.real
        agent = self.experiment.agent
        schedule = self.experiment.schedule
        cycle = self.num_filmings
        num_episodes = schedule.real_episodes[cycle]
        if not num_episodes:
            return []
        filmed: list[Trajectory] = []
        if agent.can_act:
            filmed = real.run_policy(
                lambda frames: agent.act(frames, sample=True),
                schedule.num_stacked,
                num_episodes,
                cycle,
                agent.begin_episodes,
            )
        elif self.run.step:
            self.num_skipped += 1
        is_first = cycle == 0 and not filmed  # no policy yet, or recordings only
        return real.collect(num_episodes) if is_first else filmed

    def _update_simulator(self) -> None:
        experiment = self.experiment
        # Without a time limit, which would not be reproducible.
        found = experiment.search.run_round(self.real, Budget(report=self._report))
        self.run.log_round(found, len(self.real))
        self._save()

    def _train_policy(self) -> None:
        schedule = self.experiment.schedule
        agent = self.experiment.agent
        learnt_in = self.experiment.learnt_in
        replay = self.experiment.replay
        self._report("training the policy", self.run.step / schedule.total_steps)
        worlds = self.distribution_policy.sample(schedule.num_worlds, self.rng)
        is_filmed = agent.wants_frames
        delay_steps = self.experiment.delay_steps(self._estimated_delay_steps, self.rng)
        explore = partial(agent.explore, replay=replay)
        episodes = learnt_in.play(explore, worlds, self.rng, is_filmed, delay_steps)
        replay.add(episodes)
        num_steps = len(worlds) * self.experiment.task.episode_steps
        losses = agent.update(replay, num_steps)
        self.run.step += num_steps
        earned = float(episodes.rewards.sum(1).mean())
        scalars = {"return/simulated": earned, "filmed": float(is_filmed)}
        self.run.log(len(self.real), scalars | losses)
        if time.monotonic() - self._saved_s > self.experiment.settings.checkpoint_every_s:
            self._save()

    def _score_meanwhile(self) -> None:
        """A point of a learning curve for figures; nothing learns from it."""
        experiment = self.experiment
        if experiment.truth is not None and experiment.agent.can_act:
            done = self.run.step / experiment.schedule.total_steps
            self._report("scoring the policy meanwhile", done)
            scores, _ = self._score(experiment.truth)
            means = {f"{name}/real": float(values.mean()) for name, values in scores.items()}
            self.run.log(len(self.real), means)
        self.num_scored += 1
        self._save()

    def _score(self, truth: Truth) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """See `TrainingExperiment.score`."""
        config = self.experiment.config
        return self.experiment.score(truth.for_oracle(), config.scored_episodes, config.seed)

    @property
    def _estimated_delay_steps(self) -> float | None:
        """Estimated delay of actions; None until a search has looked for it.

        Late pictures count as late actions: to a policy, both mean that it sees later what it did.
        """
        estimated = search_traits(self.experiment.search_name).estimates_delay
        is_known = self.run.num_rounds and estimated
        return self.run.estimate.late_steps(self.experiment.real.step_s) if is_known else None

    @property
    def distribution_policy(self) -> Distribution:
        """Ξ_policy: around ξ_mean; before the real world was filmed, around the start."""
        experiment = self.experiment
        if not self.num_filmings:
            range_ = experiment.config.range_dr
            return Distribution.proportional(experiment.space, experiment.start, range_)
        searched = experiment.search.distribution
        return policy_range(searched, self.run.estimate, choose_range(experiment.config))

    def finish(self, warnings: list[str], command: str | None = None) -> dict[str, Any]:
        """Score the policy on episodes not used for learning; see `Run.finish`.

        `warnings`: of the recordings, which were known before training.
        """
        experiment = self.experiment
        config = experiment.config
        metadata: dict[str, Any] = {"method": config.method, "preset": config.preset}
        metadata["policy_steps"] = self.run.step
        if experiment.search_name:
            metadata["stopped"] = experiment.search.stop_reason or "all rounds are done"
        if experiment.truth is not None:
            self._report("scoring the policy in the pseudo-real world", 1.0)
            scores, film = self._score(experiment.truth)
            fps = round(1 / experiment.real.step_s, 3)
            write_video(self.run.folder.videos / "policy.mp4", film, fps)
            metadata |= {name: outcome.mean_and_spread(values) for name, values in scores.items()}
        warnings = [*warnings, *experiment.policy_warnings(self.num_skipped)]
        return self.run.finish(self.real, metadata, warnings, command)

    def _save(self) -> None:
        counters: dict[str, Any] = {"filmings": self.num_filmings, "skipped": self.num_skipped}
        counters |= {"scored": self.num_scored, "knows_enough": self._knows_enough}
        self.run.save(**counters, rng=self.rng.bit_generator.state)
        self._saved_s = time.monotonic()

    def resume(self) -> None:
        """Continue from the newest valid checkpoint, if there is one."""
        if not (state := self.run.resume()):
            return
        self.num_filmings = state["filmings"]
        self.num_skipped = state["skipped"]
        self.num_scored = state["scored"]
        for cycle in range(self.num_filmings):
            step_s = self.experiment.real.step_s
            self.real = read_real(self.run.folder.path, cycle, step_s) + self.real
        self.rng.bit_generator.state = state["rng"]
