"""Episodes of simulated worlds in which a policy acts."""

from collections.abc import Callable, Mapping

import numpy as np
from mujoco.batch import Batch

from simtune.agents import Observation
from simtune.observation import ObservationModel
from simtune.real.gap import RealityGap
from simtune.replay_buffer import Episodes
from simtune.simulation import (
    Act,
    FrameStacker,
    Rollouts,
    Simulator,
    StrayLight,
    acting_late,
    scale_actions,
)
from simtune.tasks import Task
from simtune.vision.keypoints import Keypoints

ActOnObservation = Callable[[Observation], np.ndarray]  # (n, A) actions in [−1, 1]


class PolicyWorlds:
    """Where a task's policy acts: parameters and a policy in, whole episodes out.

    An episode ends only by its time, so that values may be bootstrapped there, or by diverging
    physics: such a world ends as a failure, one step earlier.
    """

    def __init__(
        self,
        task: Task,
        simulator: Simulator,
        num_stacked: int,
        keypoints: Keypoints | None = None,
        *,
        gap: RealityGap | None = None,
        max_delay_steps: int = 0,
        observation: ObservationModel | None = None,
    ):
        """`keypoints`: stored with filmed episodes, in pixels. Raises ValueError without a reward.

        With a `gap` a policy sees what its camera delivers. `max_delay_steps`: steps by which
        actions may be late; as many latest ones belong to the state, since they are still to come.
        `observation`: of the real world that policies are for, whose rooms may have stray light.
        """
        if task.reward is None:
            raise ValueError(f"{task.name} has no reward, so no policy can be trained in it")
        self.task, self.simulator, self._reward = task, simulator, task.reward
        self.num_stacked, self.keypoints = num_stacked, keypoints
        self.gap, self.max_delay_steps, self._observation = gap, max_delay_steps, observation
        self._space, joint = simulator.state_space, simulator.model.joint
        self._lowest_reward = 0.0  # of any live step that counts, or 0
        self._free = [joint(name).qposadr[0] for name in task.free_joints]
        self._turning = [joint(name).qposadr[0] for name in task.symmetric_hinges]
        self._turns = list(task.symmetric_hinges.values())

    @property
    def num_states(self) -> int:
        """D, the length of an `Observation`'s state: F features, and actions still under way."""
        own = len(self._space.features(np.zeros(self._space.nq + self._space.nv)))
        return own + self.max_delay_steps * self.simulator.num_actions

    @property
    def num_positions(self) -> int:
        """Number of positions, which come first; velocities follow, then actions."""
        late = self.max_delay_steps * self.simulator.num_actions
        return self.num_states - late - self._space.nv

    def observe(self, full_states: np.ndarray) -> np.ndarray:
        """(..., S) to (..., F): positions and velocities, without irrelevant ones.

        Without the actions that are still under way, which MuJoCo's state does not contain.
        """
        known = self._space.positions_and_velocities(full_states).copy()
        known[..., self._free] = 0
        known[..., self._turning] *= self._turns
        return self._space.features(known).astype(np.float32)

    def play(
        self,
        policy: ActOnObservation,
        parameters: np.ndarray,
        rng: np.random.Generator,
        film: bool = True,
        delay_steps: int | None = None,
        *,
        counts: bool = True,
    ) -> Episodes:
        """An episode in each of n worlds of (n, N) parameters; without `film` nothing is drawn.

        Actions take effect `delay_steps` late, by default the gap's; those of the episodes are the
        policy's. Unless it `counts`, neither simulated steps nor the lowest reward are noted.
        Raises RuntimeError if the policy's actions, or rewards of live worlds, are not finite.
        """
        simulator, num_steps = self.simulator, self.task.episode_steps
        if delay_steps is None:
            delay_steps = self.gap.delay_steps if self.gap else 0
        stacker, stray = self._stacker(parameters, rng) if film else (None, None)
        keypoints = self.keypoints if film else None
        actions = np.empty((len(parameters), num_steps, simulator.num_actions), np.float32)
        rollouts = simulator.play(
            parameters,
            acting_late(self._acting(policy, actions, stacker), delay_steps),
            num_steps,
            rng,
            observe=lambda batch: self._observe_batch(batch, keypoints),
            observations_per_step=self.task.action_repeat,
            counts=counts,
        )
        if stacker:
            stacker.draw(num_steps, rollouts.states[:, -1])
        frames = stacker.frames if stacker else None
        rewards = self._rewards(rollouts, counts)
        return self._episodes(rollouts, rewards, actions, frames, keypoints, stray)

    def state(self) -> dict[str, float]:
        """JSON of what earlier episodes left, by which failures are charged."""
        return {"lowest_reward": self._lowest_reward}

    def load(self, state: Mapping[str, float]) -> None:
        """Charge failures as what had this `state` would."""
        self._lowest_reward = state["lowest_reward"]

    def _stacker(
        self, parameters: np.ndarray, rng: np.random.Generator
    ) -> tuple[FrameStacker, StrayLight | None]:
        """What films worlds of (n, N) parameters, and the stray light in their rooms."""
        simulator, seen = self.simulator, self._observation
        camera = self.gap.camera(simulator.step_s, rng) if self.gap else None
        stray = seen.stray_light(len(parameters), rng) if seen else None
        size = self.task.episode_steps, self.num_stacked
        return FrameStacker(simulator, parameters, *size, camera, stray), stray

    def _acting(
        self, policy: ActOnObservation, actions: np.ndarray, stacker: FrameStacker | None
    ) -> Act:
        """What acts as the policy does, and notes its own actions in (n, T, A) `actions`."""

        def act(t: int, full_states: np.ndarray) -> np.ndarray:
            frames = stacker.draw(t, full_states) if stacker else None
            # A diverged world may hold NaN; the others continue.
            states = np.nan_to_num(self.observe(full_states))
            states = np.hstack([states, self._latest(actions, t)])
            actions[:, t] = policy(Observation(states, frames))
            if not np.isfinite(actions[:, t]).all():
                raise RuntimeError("the policy's actions are no numbers: its training diverged")
            return scale_actions(self.simulator.action_mapping, actions[:, t])

        return act

    def _latest(self, actions: np.ndarray, t: int) -> np.ndarray:
        """(n, max_delay_steps · A): those of (n, T, A) actions before step t, the newest first."""
        latest = np.zeros((len(actions), self.max_delay_steps, actions.shape[2]), np.float32)
        known = min(t, self.max_delay_steps)
        latest[:, :known] = actions[:, t - known : t][:, ::-1]
        return latest.reshape(len(actions), -1)

    def _observe_batch(self, batch: Batch, keypoints: Keypoints | None) -> np.ndarray:
        """(n, 1 + G + 2 L): the reward, which goals are reached, where keypoints are."""
        goals = [goal(batch) for goal in self.task.goals.values()]
        rated = np.stack([self._reward(batch), *goals], 1)
        return np.hstack([rated, keypoints.observe(batch)]) if keypoints else rated

    def _rewards(self, rollouts: Rollouts, counts: bool) -> np.ndarray:
        """(n, T), with failures charged, of n worlds from their `_observe_batch`."""
        n, num_steps, _ = rollouts.actions.shape
        of_parts = rollouts.observed[:, 1:, 0].reshape(n, num_steps, self.task.action_repeat)
        rewards = of_parts.sum(2)
        is_over = np.arange(num_steps) >= rollouts.lengths[:, None]
        if not np.isfinite(rewards[~is_over]).all():
            raise RuntimeError(f"the reward of {self.task.name} is no finite number everywhere")
        lowest = min(self._lowest_reward, float(rewards[~is_over].min(initial=0.0)))
        if counts:
            self._lowest_reward = lowest
        _charge_failures(rewards, is_over, lowest)
        return rewards

    def _episodes(
        self,
        rollouts: Rollouts,
        rewards: np.ndarray,
        actions: np.ndarray,
        frames: np.ndarray | None,
        keypoints: Keypoints | None,
        stray: StrayLight | None,
    ) -> Episodes:
        """Of n worlds, from their `_observe_batch`; (n, T, A) actions in [−1, 1]."""
        n, num_steps, _ = actions.shape
        repeat, num_goals = self.task.action_repeat, len(self.task.goals)
        is_whole = rollouts.lengths == num_steps
        seen = rollouts.observed[:, ::repeat, 1 + num_goals :].astype(np.float32)
        since = min(self.task.goal_steps or num_steps, num_steps) * repeat
        is_kept = (rollouts.observed[:, since:, 1 : 1 + num_goals] > 0).all(1)
        return Episodes(
            parameters=rollouts.parameters,
            full_states=rollouts.states,
            states=np.concatenate(
                [
                    self.observe(rollouts.states),
                    np.stack([self._latest(actions, t) for t in range(num_steps + 1)], 1),
                ],
                axis=2,
            ),
            actions=actions,
            rewards=rewards.astype(np.float32),
            lengths=rollouts.lengths,
            terminated=~is_whole,
            frames=frames,
            keypoints=seen.reshape(n, num_steps + 1, -1, 2) if keypoints else None,
            stray=stray and stray.to_rows(),
            reached=is_kept & is_whole[:, None],
        )


def _charge_failures(rewards: np.ndarray, is_over: np.ndarray, lowest: float) -> None:
    """Set rewards (n, T) of steps after a world diverged, `is_over`, in place.

    It earns nothing, or, where rewards may be negative, the `lowest` so far for each step that is
    left: else to diverge would be the best that a policy can do. Its last live step is charged.
    """
    rewards[is_over] = 0.0
    num_left = is_over.sum(1)
    last = np.maximum(is_over.shape[1] - num_left - 1, 0)
    rewards[np.arange(len(rewards)), last] += lowest * num_left
