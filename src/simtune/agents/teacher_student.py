"""The `fast` preset: learn from the state, then teach a student on pixels (DAgger).

Ross, Gordon and Bagnell 2011 (arXiv:1011.0686): the student acts, and learns what the teacher would
have done in the states that the student reached. Only the student meets the real world.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from simtune.agents.agent import AgentSpec, Observation
from simtune.agents.noise import disturbed, uniform_actions
from simtune.agents.recollection import Recollection
from simtune.agents.saving import Stateful, gather_tensors, scatter_tensors
from simtune.agents.student import Student
from simtune.agents.teacher import Teacher
from simtune.agents.teaching_schedule import TeacherStudentConfig, TeachingSchedule
from simtune.networks.cuda_graph import graphed, make_capturable
from simtune.networks.layers import seeded, under
from simtune.replay_buffer import ReplayBuffer, Transitions, in_parts

# What a teacher learns from, of `Transitions`
_TAUGHT_FIELDS = ("states", "actions", "rewards", "discounts", "next_states", "parameters")
_DRAWN_BATCHES = 32  # at once
_STANDARDIZED_STEPS = 4096  # whose mean and standard deviation become 0 and 1 for networks


class TeacherStudent:
    """An `Agent` that alternates: its teacher learns from states, its student from filmed episodes.

    The teacher's critics also get the `privileged` parameters.
    """

    needs_keypoints = True

    def __init__(self, spec: AgentSpec, config: TeacherStudentConfig | None = None):
        self.config = config = config or TeacherStudentConfig()
        self.device = torch.device(spec.device)
        self._privileged = torch.as_tensor(np.flatnonzero(spec.privileged), device=self.device)
        self._schedule = TeachingSchedule.of(config, spec)
        self._num_actions, self._num_positions = spec.num_actions, spec.num_positions
        self._num_latest = spec.max_delay_steps * spec.num_actions
        self._generator = torch.Generator(self.device).manual_seed(spec.seed)
        with seeded(spec.seed):
            self.teacher = Teacher(
                spec.num_states, spec.num_actions, len(self._privileged), config.teacher
            ).to(self.device)
            self.student = Student(spec, config.student, self._generator)
        self.begin_episodes()
        self._begin_steps()
        self._recollection = Recollection(config.renewed_episodes)
        self.num_steps = self._num_filmed = 0

    def _begin_steps(self) -> None:
        """Make the teacher's updates anew, which are graphs on a GPU."""
        make_capturable(self.teacher.optimizer, self.device)
        self._teach = graphed(self._update_teacher, self._generator)

    @property
    def can_act(self) -> bool:
        """Whether the student has begun to learn."""
        return self.student.num_updates > 0

    @property
    def wants_frames(self) -> bool:
        """See `TeachingSchedule`."""
        return self._schedule.wants_frames(self.num_steps, self._num_filmed)

    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """See `Agent`. A sample is the best action with noise."""
        seen = torch.from_numpy(frames).to(self.device)
        if len(self._latest) != len(seen):  # an episode's first step
            self._latest = torch.zeros(len(seen), self._num_latest, device=self.device)
        latest = self._latest
        actions = self.student.act(seen, latest)
        if sample:
            actions = self._disturbed(actions, self.config.noise)
        self._latest = torch.cat([actions, latest], 1)[:, : self._num_latest]
        return actions.cpu().numpy()

    def begin_episodes(self) -> None:
        """See `Agent`."""
        self._latest = torch.zeros(0, self._num_latest)  # actions in n worlds, the newest first
        self.student.forget()

    def explore(self, observation: Observation, replay: ReplayBuffer) -> np.ndarray:
        """The teacher alone if nothing is filmed; else the student, more and more."""
        states = torch.from_numpy(observation.state).to(self.device)
        if self.num_steps < self.config.random_steps:
            actions = uniform_actions(len(states), self._num_actions, self._generator)
        elif observation.frames is None:
            actions = self._disturbed(self.teacher.act(states), self.teacher_noise)
        else:
            reached = self._uniform(len(states), 1) * self._schedule.trusting_steps
            acts_itself = reached < self._num_filmed
            frames = torch.from_numpy(observation.frames).to(self.device)
            own = self.student.act(frames, self._latest_of(states))
            best = torch.where(acts_itself, own, self.teacher.act(states))
            actions = self._disturbed(best, self._filmed_noise(len(best)))
        return actions.cpu().numpy()

    def update(self, replay: ReplayBuffer, num_steps: int) -> dict[str, float]:
        """Train the teacher after episodes that were not filmed, the student after filmed ones."""
        filmed = self.wants_frames
        self.num_steps += num_steps
        self._num_filmed += num_steps if filmed else 0
        none = dict.fromkeys(("critic", "actor", "detector", "imitation"), torch.tensor(torch.nan))
        train = self._train_student if filmed else self._train_teacher
        losses = none | train(replay, num_steps)
        return {f"loss/{name}": float(loss) for name, loss in losses.items()}

    def _train_teacher(self, replay: ReplayBuffer, num_steps: int) -> dict[str, torch.Tensor]:
        self.teacher.normalized.fit(self._sample(replay, _STANDARDIZED_STEPS).states)
        noise = torch.full((), self.teacher_noise, device=self.device)
        losses = torch.full((2,), torch.nan)
        size = self.config.teacher.batch_size
        num_updates = round(num_steps * self.config.teacher_updates_per_step)
        for num in in_parts(num_updates, _DRAWN_BATCHES):
            for batch in self._sample(replay, num * size).split(size):
                losses = self._teach(*(getattr(batch, name) for name in _TAUGHT_FIELDS), noise)
        return dict(zip(("critic", "actor"), losses, strict=True))

    def _update_teacher(self, *tensors: torch.Tensor) -> torch.Tensor:
        *batch, noise = tensors
        known = Transitions(**dict(zip(_TAUGHT_FIELDS, batch, strict=True)))
        return self.teacher.update(known, noise, self._generator)

    def _train_student(self, replay: ReplayBuffer, num_steps: int) -> dict[str, torch.Tensor]:
        """Train its detector, then its head on what that sees in new and remembered episodes."""
        progress = self._schedule.progress(self.num_steps)
        detector = self._train_detector(replay, num_steps, progress)
        return {"detector": detector, "imitation": self._train_head(replay, num_steps, progress)}

    def _train_detector(
        self, replay: ReplayBuffer, num_steps: int, progress: float
    ) -> torch.Tensor:
        student, loss = self.student, torch.tensor(torch.nan)
        is_first = not student.num_updates
        for _ in range(self._schedule.num_detector_updates(num_steps, is_first)):
            size = self.config.student.detector.batch_size
            frames, keypoints, states = replay.pictures(size, self._generator)
            positions = self.teacher.normalized(states)[:, : self._num_positions]
            loss = student.learn_to_see(frames, keypoints, positions, progress)
        return loss

    def _train_head(self, replay: ReplayBuffer, num_steps: int, progress: float) -> torch.Tensor:
        student, loss = self.student, torch.tensor(torch.nan)
        slots = replay.latest_filmed(self.config.remembered_episodes)
        lengths = replay.lengths[slots].to(self.device)
        seen = self._recollection.look(
            replay.numbers(slots),
            lambda i: student.detect_recorded(replay.frames[slots[i]]),
        )
        states = replay.states[slots]
        best, latest = self.teacher.act(states), self._latest_of(states)

        def draw(num: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
            e = torch.randint(len(slots), (num,), generator=self._generator, device=self.device)
            t = (self._uniform(num) * lengths[e]).long()
            stacks = seen[e[:, None], (t[:, None] + replay.stack_offsets).clamp(min=0)]
            return stacks, latest[e, t], best[e, t]

        student.standardize_by(*draw(_STANDARDIZED_STEPS)[:2])
        size = self.config.student.batch_size
        for num in in_parts(round(num_steps * self.config.head_updates_per_step), _DRAWN_BATCHES):
            drawn = (values.split(size) for values in draw(num * size))
            for stacks, late, wanted in zip(*drawn, strict=True):
                loss = student.learn_to_act(stacks, late, wanted, progress)
        return loss

    def _latest_of(self, states: torch.Tensor) -> torch.Tensor:
        """(..., D) to (..., L): actions at the end of states, see `AgentSpec.max_delay_steps`."""
        return states[..., states.shape[-1] - self._num_latest :]

    def _sample(self, replay: ReplayBuffer, batch_size: int) -> Transitions:
        batch = replay.sample(batch_size, self._generator, with_frames=False)
        return replace(batch, parameters=batch.parameters[:, self._privileged])

    def _uniform(self, *shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=self._generator, device=self.device)

    def _disturbed(self, actions: torch.Tensor, noise: float | torch.Tensor) -> torch.Tensor:
        return disturbed(actions, noise, self._generator)

    def _filmed_noise(self, num_worlds: int) -> torch.Tensor:
        """(n, 1) standard deviations, none to `filmed_noise`, small in most worlds.

        They show the student how to recover (Laskey et al. 2017, arXiv:1703.09327). A good one
        hardly falls in simulation. In the real world it does, and finds itself where neither its
        detector nor its head has ever been.
        """
        shares = torch.linspace(0, 1, num_worlds, device=self.device)
        if num_worlds == 1:
            shares = self._uniform(1)
        return self.config.filmed_noise * shares.square()[:, None]

    @property
    def teacher_noise(self) -> float:
        """The present standard deviation of the teacher's exploration."""
        return self._schedule.teacher_noise(self.num_steps)

    def tensors(self) -> dict[str, torch.Tensor]:
        """See `Agent`."""
        seen = {f"recollection.{key}": t for key, t in self._recollection.tensors().items()}
        return gather_tensors(self._stateful(), self._generator) | seen

    def state(self) -> dict[str, Any]:
        """See `Agent`."""
        return {
            "num_steps": self.num_steps,
            "num_filmed": self._num_filmed,
            "num_student_updates": self.student.num_updates,
        }

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """See `Agent`."""
        scatter_tensors(self._stateful(), self._generator, tensors)
        self._recollection.load(under("recollection.", tensors), self.device)
        self.num_steps, self._num_filmed = state["num_steps"], state["num_filmed"]
        self.student.num_updates = state["num_student_updates"]
        self._begin_steps()  # graphs hold the old moments
        self.student.begin_steps()

    def _stateful(self) -> Stateful:
        return {
            "teacher": self.teacher,
            "student": self.student,
            "teacher_optimizer": self.teacher.optimizer,
            "sight_optimizer": self.student.detector_optimizer,
            "head_optimizer": self.student.head_optimizer,
        }
