"""The `fast` preset: learn from the state, then teach a student on pixels (DAgger).

Ross, Gordon and Bagnell 2011 (arXiv:1011.0686): the student acts, the teacher says what it would
have done in the states that the student got into. Only the student meets the real world.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from simtune.agents.agent import Seen
from simtune.agents.noise import disturbed, falling, uniform_actions
from simtune.agents.saving import Parts, gather_tensors, scatter_tensors
from simtune.agents.student import Student, StudentConfig
from simtune.agents.teacher import Teacher, TeacherConfig
from simtune.networks import seeded
from simtune.replay import Replay, Transitions


@dataclass(frozen=True, kw_only=True)
class TeacherStudentConfig:
    teacher: TeacherConfig = field(default_factory=TeacherConfig)
    student: StudentConfig = field(default_factory=StudentConfig)
    teacher_share: float = 0.8  # of the steps before anybody sees the student, until it begins
    noise_share: float = 0.4  # of all steps, in which the teacher's noise falls
    filmed_share: float = 0.7  # of the steps after that
    random_steps: int = 3_000  # at the start
    teacher_updates_per_step: float = 0.5
    detector_updates_per_step: float = 0.03
    first_detector_factor: float = 3.0  # so many times more of them at first: it is blind
    head_updates_per_step: float = 0.25
    remembered_episodes: int = 96  # filmed ones that the student learns to act in
    trusting_share: float = 0.1  # of all steps in which teacher and student take turns
    noise: float = 0.1  # standard deviation, added to what a student does while it learns


class TeacherStudent:
    """An `Agent`."""

    def __init__(
        self,
        *,
        image_size: int,
        num_stacked: int,
        num_keypoints: int,
        num_states: int,
        num_positions: int,  # the first of them, without velocities
        num_actions: int,
        knows: np.ndarray,  # (N,) bool: parameters that the teacher's critics are told
        total_steps: int,  # of the whole training: what shares are of
        first_tried: int,  # after so many steps it is tried out in reality
        round_steps: int,  # between two updates
        config: TeacherStudentConfig | None = None,
        seed: int = 0,
        device: torch.device | str = "cpu",
    ):
        self.config = config = config or TeacherStudentConfig()
        self.device = torch.device(device)
        self._knows = torch.as_tensor(np.flatnonzero(knows), device=device)
        self._total_steps, self._num_actions = total_steps, num_actions
        # The student, after so many steps: a round of them, at least, before it is tried out
        latest = (-(-first_tried // round_steps) - 1) * round_steps - 1
        self._begins = max(1.0, min(config.teacher_share * first_tried, latest))
        self._num_positions = num_positions
        with seeded(seed):
            sizes = (num_states, num_actions, len(self._knows))
            self.teacher = Teacher(*sizes, config.teacher).to(device)
            sizes = (num_keypoints, num_positions, image_size, num_stacked, num_actions)
            self.student = Student(*sizes, config.student).to(device)
        self._generator = torch.Generator(self.device).manual_seed(seed)
        self.num_steps = self._num_filmed = 0

    @property
    def is_ready(self) -> bool:
        return self.student.num_updates > 0

    @property
    def looks(self) -> bool:
        return self._num_filmed < self.config.filmed_share * (self.num_steps - self._begins)

    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """See `Agent`. A sample is the best action with noise."""
        actions = self.student.act(torch.from_numpy(frames).to(self.device))
        if sample:
            actions = self._disturbed(actions, self.config.noise)
        return actions.cpu().numpy()

    def explore(self, seen: Seen) -> np.ndarray:
        """The teacher alone, while nobody films; then the student, more and more."""
        states = torch.from_numpy(seen.state).to(self.device)
        if self.num_steps < self.config.random_steps:
            actions = uniform_actions(len(states), self._num_actions, self._generator)
        elif seen.frames is None:
            actions = self._disturbed(self.teacher.act(states), self._teacher_noise)
        else:
            trusting_steps = self.config.trusting_share * self._total_steps
            acts_itself = self._uniform(len(states), 1) * trusting_steps < self._num_filmed
            own = self.student.act(torch.from_numpy(seen.frames).to(self.device))
            best = torch.where(acts_itself, own, self.teacher.act(states))
            actions = self._disturbed(best, self.config.noise)
        return actions.cpu().numpy()

    def update(self, replay: Replay, num_steps: int) -> dict[str, float]:
        """Teach the teacher after episodes that nobody filmed, the student after those others."""
        filmed = self.looks
        self.num_steps += num_steps
        self._num_filmed += num_steps if filmed else 0
        none = dict.fromkeys(("critic", "actor", "detector", "imitation"), torch.tensor(torch.nan))
        losses = self._study(replay, num_steps) if filmed else self._teach(replay, num_steps)
        return {f"loss/{name}": float(loss) for name, loss in (none | losses).items()}

    def _teach(self, replay: Replay, num_steps: int) -> dict[str, torch.Tensor]:
        self.teacher.normalize_by(self._sample(replay, 4096).states)
        losses = {}
        for _ in range(round(num_steps * self.config.teacher_updates_per_step)):
            batch = self._sample(replay, self.config.teacher.batch_size)
            losses = self.teacher.update(batch, self._teacher_noise, self._generator)
        return losses

    def _study(self, replay: Replay, num_steps: int) -> dict[str, torch.Tensor]:
        """See better, look at the latest episodes again, do there as the teacher would."""
        config, student, losses = self.config, self.student, {}
        progress = (self.num_steps - self._begins) / (self._total_steps - self._begins)
        num_updates = num_steps * config.detector_updates_per_step
        if not student.num_updates:
            num_updates *= config.first_detector_factor
        for _ in range(round(num_updates)):
            size = config.student.detector.batch_size
            frames, keypoints, states = replay.pictures(size, self._generator)
            positions = self.teacher.normalized(states)[:, : self._num_positions]
            losses["detector"] = student.learn_to_see(
                frames, keypoints, positions, progress, self._generator
            )

        slots = replay.latest_filmed(config.remembered_episodes)
        lengths = replay.lengths[slots].to(self.device)
        seen = torch.stack([student.look(replay.frames[slot]) for slot in slots])
        taught = self.teacher.act(replay.states[slots])
        for _ in range(round(num_steps * config.head_updates_per_step)):
            shape = (config.student.batch_size,)
            e = torch.randint(len(slots), shape, generator=self._generator, device=self.device)
            t = (self._uniform(*shape) * lengths[e]).long()
            stacks = seen[e[:, None], (t[:, None] + replay.stack_offsets).clamp(min=0)]
            losses["imitation"] = student.learn_to_act(stacks, taught[e, t], progress)
        return losses

    def _sample(self, replay: Replay, batch_size: int) -> Transitions:
        batch = replay.sample(batch_size, self._generator, with_frames=False)
        return replace(batch, parameters=batch.parameters[:, self._knows])

    def _uniform(self, *shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=self._generator, device=self.device)

    def _disturbed(self, actions: torch.Tensor, noise: float) -> torch.Tensor:
        return disturbed(actions, noise, self._generator)

    @property
    def _teacher_noise(self) -> float:
        falls_over = self.config.noise_share * self._total_steps
        return falling(self.config.teacher.noise, self.num_steps / falls_over)

    def tensors(self) -> dict[str, torch.Tensor]:
        return gather_tensors(self._parts(), self._generator)

    def state(self) -> dict[str, Any]:
        return {
            "num_steps": self.num_steps,
            "num_filmed": self._num_filmed,
            "num_student_updates": self.student.num_updates,
        }

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        scatter_tensors(self._parts(), self._generator, tensors)
        self.num_steps, self._num_filmed = state["num_steps"], state["num_filmed"]
        self.student.num_updates = state["num_student_updates"]

    def _parts(self) -> Parts:
        return {
            "teacher": self.teacher,
            "student": self.student,
            "teacher_optimizer": self.teacher.optimizer,
            "sight_optimizer": self.student.detector_optimizer,
            "head_optimizer": self.student.head_optimizer,
        }
