"""What `simtune tune` and `simtune check` are asked."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from simtune.config.recordings import RecordingsConfig
from simtune.errors import InputError

SearchName = Literal["posterior", "paper", "regression"]


@dataclass(frozen=True, kw_only=True)
class TuneConfig(RecordingsConfig):
    """Find a simulator's parameters from video and actions of the real world.

    Writes result.json, report.html, metrics and videos into OUT. The same command goes on with
    a run that was interrupted.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    out: Path
    """The run's folder."""
    real: str = "pseudo"
    """The real world: `pseudo`, a simulated one that is filmed and scored against, recordings of
    video and actions (a LeRobotDataset v3, pairs of mp4 and csv, or HDF5: docs/recordings.md), or
    a robot: `xarm`, `lerobot`."""
    robot: Path | None = None
    """With `xarm` and `lerobot`: a TOML file of the robot, its limits and its camera."""
    move: bool = False
    """Let the robot move; without it a dry run says what would be in the way (docs/robot.md)."""
    real_parameters: Path | None = None
    """With `pseudo`: a JSON object of true values, {name: value}; by default all are nominal."""
    real_gap: bool = False
    """With `pseudo`: another renderer, video compression, camera noise and actions that come a
    step late stand between the simulator and that world. Needs OpenGL."""
    real_episodes: int | None = None
    """How many real episodes to film (by default 5), or to take from the recordings (by default
    all, at most 10)."""
    search: SearchName = "posterior"
    """posterior: read survival curves; paper: small steps up or down; regression: its baseline."""
    budget_minutes: float = 8.0
    """Stop after so many minutes of wall time."""
    seed: int = 0
    """Of all random numbers; with `pseudo` it also chooses which parameters start too high."""

    def check(self) -> None:
        """Raises InputError for numbers that make no sense."""
        self.check_recordings(self.real not in ("pseudo", "xarm", "lerobot"))
        if self.real_episodes is not None and self.real_episodes < 1:
            raise InputError(f"--real-episodes must be at least 1, got {self.real_episodes}")
        if not self.budget_minutes > 0:
            raise InputError(f"--budget-minutes must be above 0, got {self.budget_minutes:g}")
        if self.real_gap and self.real != "pseudo":
            raise InputError("--real-gap goes with --real pseudo only")
        if self.seed < 0:
            raise InputError(f"--seed must not be negative, got {self.seed}")


@dataclass(frozen=True, kw_only=True)
class CheckConfig(RecordingsConfig):
    """Say, before any training, what each parameter changes and what recordings can tell of it.

    Takes seconds, beside reading recordings, and writes no file. What a parameter "shows" is the
    best that can be hoped for.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    real: Path | None = None
    """Recordings (docs/recordings.md), whose actions are replayed; by default they are random, or
    the task's script with noise. All episodes are looked through."""
    episodes: int | None = None
    """How many episodes to simulate (by default 5), or to replay of the recordings (by default
    all, at most 10)."""
    seed: int = 0
    """Of the actions and of where simulated episodes start."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def check(self) -> None:
        """Raises InputError for what makes no sense."""
        self.check_recordings(self.real is not None)
        if self.episodes is not None and self.episodes < 1:
            raise InputError(f"--episodes must be at least 1, got {self.episodes}")
        if self.seed < 0:
            raise InputError(f"--seed must not be negative, got {self.seed}")
