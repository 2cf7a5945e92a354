"""When a teacher and its student learn, and how much, in the course of a training."""

from dataclasses import dataclass, field

from simtune.agents.agent import AgentSpec
from simtune.agents.noise import falling
from simtune.agents.student import StudentConfig
from simtune.agents.teacher import TeacherConfig


@dataclass(frozen=True, kw_only=True)
class TeacherStudentConfig:
    """Of both, and their schedule; shares are of steps in simulation."""

    teacher: TeacherConfig = field(default_factory=TeacherConfig)
    student: StudentConfig = field(default_factory=StudentConfig)
    teacher_share: float = 0.8  # of the steps before the student's first trial, until it begins
    noise_share: float = 0.4  # of all steps, over which the teacher's noise falls
    filmed_share: float = 0.7  # of the steps after that, which are filmed
    random_steps: int = 3_000  # at the start
    teacher_updates_per_step: float = 0.5
    # Bounds; within them, so many that all filmed steps together give `detector_updates`
    detector_updates_per_step: tuple[float, float] = (0.06, 0.12)
    detector_updates: int = 2_400
    first_detector_factor: float = 3.0  # on the number of first updates, when it cannot see yet
    head_updates_per_step: float = 0.25
    remembered_episodes: int = 96  # filmed ones, from which the student learns to act
    renewed_episodes: int = 16  # of these, in which it detects anew each time, besides new ones
    trusting_share: float = 0.1  # of all steps, over which the student takes over from the teacher
    noise: float = 0.1  # standard deviation, added to the student's actions in the real world
    filmed_noise: float = 0.4  # the same in the one of the filmed worlds with the most


@dataclass(frozen=True)
class TeachingSchedule:
    """Of a training with `total_steps` in simulation; `num_filmed` of `num_steps` were filmed."""

    config: TeacherStudentConfig
    total_steps: int
    begins: float  # the step after which the student learns
    detector_updates_per_step: float  # of filmed steps

    @classmethod
    def of(cls, config: TeacherStudentConfig, spec: AgentSpec) -> "TeachingSchedule":
        # At least a round before the student's first trial
        period = spec.steps_between_updates
        latest = (-(-spec.steps_before_trial // period) - 1) * period - 1
        shortest = min(1.0, spec.total_steps / 2)
        begins = max(shortest, min(config.teacher_share * spec.steps_before_trial, latest))
        to_film = config.filmed_share * (spec.total_steps - begins)
        least, most = config.detector_updates_per_step
        per_step = min(most, max(least, config.detector_updates / to_film))
        return cls(config, spec.total_steps, begins, per_step)

    def wants_frames(self, num_steps: int, num_filmed: int) -> bool:
        """Never before the student begins; then for `filmed_share` of the steps."""
        return num_filmed < self.config.filmed_share * (num_steps - self.begins)

    def progress(self, num_steps: int) -> float:
        """Share of the student's time that is over."""
        return (num_steps - self.begins) / (self.total_steps - self.begins)

    def teacher_noise(self, num_steps: int) -> float:
        """Standard deviation of the teacher's exploration."""
        falls_over = self.config.noise_share * self.total_steps
        return falling(self.config.teacher.noise, num_steps / falls_over)

    @property
    def trusting_steps(self) -> float:
        """Filmed steps over which the student takes over from the teacher."""
        return self.config.trusting_share * self.total_steps

    def num_detector_updates(self, num_steps: int, is_first: bool) -> int:
        """After so many filmed steps; the first time it cannot see yet."""
        num_updates = num_steps * self.detector_updates_per_step
        return round(num_updates * (self.config.first_detector_factor if is_first else 1))
