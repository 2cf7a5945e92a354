"""Episodes of simulated worlds that a policy acts in."""

from collections.abc import Callable

import numpy as np
from mujoco.batch import Batch

from simtune.agents.agent import Seen
from simtune.replay import Episodes
from simtune.simulation import Projector, Simulator, StateSpace, scale_actions
from simtune.tasks import Task
from simtune.vision.keypoints import Keypoints

Policy = Callable[[Seen], np.ndarray]  # (n, A) actions in [−1, 1]


class Environment:
    """A task's worlds: parameters and a policy in, whole episodes out.

    Nothing ends an episode but its time, so that values may be bootstrapped at its end, and a
    world whose physics diverges: that one ends as a failure, one step earlier.
    """

    def __init__(
        self,
        task: Task,
        simulator: Simulator,
        num_stacked: int,
        keypoints: Keypoints | None = None,
    ):
        """`keypoints`: what is noted down of filmed episodes, besides."""
        if task.reward is None:
            raise ValueError(f"{task.name} has no reward, so no policy can be trained in it")
        self.task, self.simulator, self._reward = task, simulator, task.reward
        self.num_stacked, self.keypoints = num_stacked, keypoints
        self._space = StateSpace(simulator.model)
        joint = simulator.model.joint
        self._free = [joint(name).qposadr[0] for name in task.free_joints]
        self._turning = [joint(name).qposadr[0] for name in task.symmetric_hinges]
        self._turns = list(task.symmetric_hinges.values())

    @property
    def num_states(self) -> int:
        """Numbers that `observe` gives."""
        return self.observe(np.zeros((1, 1 + self._space.nq + self._space.nv))).shape[1]

    @property
    def num_positions(self) -> int:
        """The first so many of them; velocities follow."""
        return self.num_states - self._space.nv

    def observe(self, states: np.ndarray) -> np.ndarray:
        """(..., S) rows to (..., D): positions and velocities, without what makes no difference."""
        # A row begins with time.
        known = states[..., 1 : 1 + self._space.nq + self._space.nv].copy()
        known[..., self._free] = 0
        known[..., self._turning] *= self._turns
        return self._space.features(known).astype(np.float32)

    def play(
        self,
        policy: Policy,
        parameters: np.ndarray,
        rng: np.random.Generator,
        film: bool = True,
    ) -> Episodes:
        """An episode in each of n worlds of (n, N) parameters; without `film` nothing is drawn.

        Raises RuntimeError where the policy's actions are not finite, or rewards of live worlds.
        """
        simulator, num_steps = self.simulator, self.task.episode_steps
        projector = Projector(simulator, parameters, num_steps, self.num_stacked) if film else None
        actions = np.empty((len(parameters), num_steps, simulator.num_actions), np.float32)

        def act(t: int, states: np.ndarray) -> np.ndarray:
            frames = projector.show(t, states) if projector else None
            # A world that died may hold what is no number; the others go on.
            actions[:, t] = policy(Seen(np.nan_to_num(self.observe(states)), frames))
            if not np.isfinite(actions[:, t]).all():
                raise RuntimeError("the policy's actions are no numbers: its training diverged")
            return scale_actions(simulator.action_mapping, actions[:, t])

        repeat, n = self.task.action_repeat, len(parameters)
        noted, goals = self.keypoints if film else None, self.task.goals

        def watch(batch: Batch) -> np.ndarray:
            told = np.stack([self._reward(batch), *(goal(batch) for goal in goals.values())], 1)
            return np.hstack([told, noted.record(batch)]) if noted else told

        played = simulator.play(
            parameters, act, num_steps, rng, watch=watch, watches_per_step=repeat
        )
        if projector:
            projector.show(num_steps, played.states[:, -1])
        watched = played.watched
        assert watched is not None, "asked for above"
        rewards = watched[:, 1:, 0].reshape(n, num_steps, repeat).sum(2)
        rewards[np.arange(num_steps) >= played.lengths[:, None]] = 0  # a dead world earns nothing
        if not np.isfinite(rewards).all():
            raise RuntimeError(f"the reward of {self.task.name} is no finite number everywhere")
        reached = watched[:, -1, 1 : 1 + len(goals)] > 0
        keypoints = None
        if noted:
            seen = watched[:, ::repeat, 1 + len(goals) :]
            keypoints = seen.reshape(n, num_steps + 1, -1, 2).astype(np.float32)
        return Episodes(
            parameters=parameters,
            rows=played.states,
            states=self.observe(played.states),
            actions=actions,
            rewards=rewards.astype(np.float32),
            lengths=played.lengths,
            terminated=played.lengths < num_steps,
            frames=projector.frames if projector else None,
            keypoints=keypoints,
            reached=reached & (played.lengths == num_steps)[:, None],
        )
