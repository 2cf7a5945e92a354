"""Algorithm 1 of the paper, top to bottom: learn to act while the simulator is tuned.

Initialize D_policy, agent, D_sp, SPM q_φ                 make_parts
Initialize simulator with Ξ⁰                              make_parts
Fill D_sp from a random policy, pretrain q_φ              _look_at_real, _update_simulator
for step k
    policy training phase                                 _train_policy
    sim param training phase                              _update_simulator
    update simulation from real                           _look_at_real, _update_simulator

The last three go round in a circle; here a cycle begins with the real world, since that is where
the first, random one has to begin. What each part is: `parts.py`; how often: `schedule.py`.
"""

import math
import time
from dataclasses import asdict
from typing import Any

import numpy as np

from simtune import outcome
from simtune.comparison import write_comparison
from simtune.config import TrainConfig
from simtune.parts import Parts, make_parts
from simtune.progress import ReportProgress, silent
from simtune.randomization import Distribution
from simtune.recordings import write_video
from simtune.report import write_report
from simtune.run import RunFolder
from simtune.trajectory import Trajectory
from simtune.tuning.search import unsure

_CHECKPOINT_EVERY_S = 60.0


def train(config: TrainConfig, say: ReportProgress = silent) -> dict[str, Any]:
    """Carry out Algorithm 1; returns the content of result.json.

    A run that was interrupted goes on from its last checkpoint, to the same result.
    Raises InputError for what cannot be used, with nothing written.
    """
    parts = make_parts(config, say)
    asked = outcome.asked(config, parts.task, parts.start, parts.real.facts, parts.truth)
    with RunFolder.create(config.out, asked) as run:
        training = Training(config, parts, run, say)
        training.resume()
        training.carry_out()
        run.write_result(result := training.result())
        run.write_curves(outcome.curves(training.estimate))
        if training.num_looks and parts.search_name:
            say("filming the comparison", 1.0)
            simulator, estimate = parts.environment.simulator, training.estimate
            first = training.real[0]  # of which the estimate knows how it began
            write_comparison(run.videos, simulator, first, parts.start, estimate, config.seed)
        write_report(run.path)
    return result


class Training:
    """Where Algorithm 1 is. Its counters only grow, so that it can go on from any of them."""

    def __init__(self, config: TrainConfig, parts: Parts, run: RunFolder, say: ReportProgress):
        self.config, self.parts, self.run, self._say = config, parts, run, say
        self.real: list[Trajectory] = []  # the latest first
        self.estimate = unsure(parts.search.distribution, "not identifiable")
        self.num_looks = self.num_untried = self.num_searches = self.num_steps = 0
        self.rng = np.random.default_rng(config.seed)
        self._began_s = self._saved_s = time.monotonic()

    def carry_out(self) -> None:
        """Algorithm 1."""
        schedule = self.parts.schedule
        # Sim-to-real (Sec. VI-B): first a policy by domain randomisation around the start
        while self.num_steps < schedule.pretrain_steps:
            self._train_policy()
        for cycle in range(len(schedule.policy_steps)):
            # Collect samples by running π_θ in the real world; at first, by random actions
            if self.num_looks <= cycle:
                self._look_at_real(schedule.real_episodes[cycle])
            # Collect simulated trajectories, train q_φ, Ξ ← Ξ + α q_φ(o_real, a_real, ξ_mean)
            while self.num_searches < sum(schedule.searches[: cycle + 1]):
                self._update_simulator()
            # At each reset, sample ξ_sim ~ Ξ_policy; collect in D_policy, train π_θ
            while self.num_steps < schedule.steps_after(cycle):
                self._train_policy()
        self._save()

    def _look_at_real(self, num_episodes: int) -> None:
        real, agent, cycle = self.parts.real, self.parts.agent, self.num_looks
        seen: list[Trajectory] = []
        if num_episodes and agent.can_act:
            stacked = self.parts.schedule.num_stacked
            seen = real.run_policy(
                lambda f: agent.act(f, sample=True), stacked, num_episodes, cycle
            )
        elif num_episodes and self.num_steps:
            self.num_untried += 1
        if num_episodes and cycle == 0 and not seen:  # no policy yet, or recordings only
            seen = real.collect(num_episodes)
        self.run.write_real(cycle, seen)
        self.real = seen + self.real
        self.num_looks += 1
        self._save()

    def _update_simulator(self) -> None:
        search = self.parts.search
        self.estimate, events, losses = search.iterate(self.real, math.inf)
        self.num_searches += 1
        for event in events:
            self.run.log_event(self.num_steps, self._wall_s, **asdict(event))
        if self.config.drop_far:
            near = self.distribution_policy
            self.parts.replay.drop_far(near.low, near.high)
        told = outcome.scalars(search, self.estimate) | losses
        self._log({"iteration": self.num_searches, **told})
        self._save()

    def _train_policy(self) -> None:
        parts = self.parts
        self._say("training the policy", self.num_steps / parts.schedule.total_steps)
        worlds = self.distribution_policy.sample(parts.schedule.num_worlds, self.rng)
        film = parts.agent.wants_frames
        episodes = parts.environment.play(parts.agent.explore, worlds, self.rng, film)
        parts.replay.add(episodes)
        num_steps = worlds.shape[0] * parts.task.episode_steps
        losses = parts.agent.update(parts.replay, num_steps)
        self.num_steps += num_steps
        trained = {"return/simulated": float(episodes.rewards.sum(1).mean()), "filmed": float(film)}
        self._log(trained | losses)
        if time.monotonic() - self._saved_s > _CHECKPOINT_EVERY_S:
            self._save()

    @property
    def distribution_policy(self) -> Distribution:
        """Ξ_policy: near ξ_mean, for methods that have an opinion about it."""
        parts = self.parts
        if not self.num_looks:  # pretraining: nobody has an opinion yet
            return Distribution.proportional(parts.space, parts.start, self.config.range_dr)
        mean = parts.search.distribution.mean
        return Distribution.proportional(parts.space, mean, parts.range_policy)

    def result(self) -> dict[str, Any]:
        """Score the policy on episodes that nothing was learnt from; the content of result.json."""
        config, parts = self.config, self.parts
        facts = {
            "task": parts.task.name,
            "method": config.method,
            "preset": config.preset,
            "search": parts.search_name,
            "seed": config.seed,
            "real": config.real,
            "real_episodes": len(self.real),
            "policy_steps": self.num_steps,
            "step_s": parts.real.step_s,
            "sim_steps": parts.environment.simulator.num_steps,
            "num_diverged": parts.environment.simulator.num_diverged,
            "wall_s": round(self._wall_s, 1),
            **outcome.recordings(parts.real.facts),
        }
        if parts.truth is not None:
            self._say("scoring the policy in the pseudo-real world", 1.0)
            num, world = config.scored_episodes, parts.truth.for_oracle()
            scores, film = parts.score(world, num, config.seed)
            write_video(self.run.videos / "policy.mp4", film, round(1 / parts.real.step_s, 3))
            facts |= {name: outcome.summary(values) for name, values in scores.items()}
        result = outcome.result(facts, parts.space, parts.start, self.estimate, parts.truth)
        return result | {"warnings": parts.doubts(self.real, self.num_untried) + result["warnings"]}

    @property
    def _wall_s(self) -> float:
        return time.monotonic() - self._began_s

    def _log(self, scalars: dict[str, float]) -> None:
        self.run.log_metrics(self.num_steps, len(self.real), self._wall_s, scalars)

    def _save(self) -> None:
        parts, simulator = self.parts, self.parts.environment.simulator
        tensors, state = parts.saved()
        state |= {"step": self.num_steps, "looks": self.num_looks, "searches": self.num_searches}
        state |= {"sim_steps": simulator.num_steps, "num_diverged": simulator.num_diverged}
        state |= {"untried": self.num_untried, "step_s": parts.real.step_s}
        state |= {"wall_s": self._wall_s, "rng": self.rng.bit_generator.state}
        self.run.save_checkpoint(tensors, state | {"estimate": outcome.to_json(self.estimate)})
        self._saved_s = time.monotonic()

    def resume(self) -> None:
        """Go on from the newest sound checkpoint, if there is one."""
        if not (checkpoint := self.run.load_checkpoint()):
            return
        tensors, state = checkpoint
        self.parts.load(tensors, state)
        simulator = self.parts.environment.simulator
        simulator.num_steps, simulator.num_diverged = state["sim_steps"], state["num_diverged"]
        self.num_steps, self.num_searches = state["step"], state["searches"]
        self.num_looks, self.num_untried = state["looks"], state.get("untried", 0)
        self.estimate = outcome.from_json(state["estimate"])
        for cycle in range(self.num_looks):
            self.real = self.run.read_real(cycle, self.parts.real.step_s) + self.real
        self.rng.bit_generator.state = state["rng"]
        self._began_s = time.monotonic() - state["wall_s"]
