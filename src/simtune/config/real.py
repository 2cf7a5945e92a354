"""The options of every command that reads recordings, or works with a real world."""

from dataclasses import dataclass
from pathlib import Path

from simtune.config.checks import check_seed, flag
from simtune.errors import InputError

ROBOTS = ("xarm", "lerobot")
_SMALLEST_PX, _LARGEST_PX = 32, 256


@dataclass(frozen=True, kw_only=True)
class RecordingsConfig:
    """How recordings (docs/recordings.md) are read."""

    camera: str | None = None
    """The recordings' camera, such as observation.images.front; needed where there are several."""
    actions: str | None = None
    """Which of the recordings' actions, NAME,NAME,..., in the order of the model's; by default
    all."""
    control_hz: float | None = None
    """Steps a second to bring recordings to; by default the rate that they were made at."""

    @property
    def action_names(self) -> tuple[str, ...] | None:
        if self.actions is None:
            return None
        return tuple(name.strip() for name in self.actions.split(","))

    @property
    def observed(self) -> tuple[str, ...] | None:
        """Names of what is looked at, see `Observes`."""
        return ("cameras",)

    def check_recordings(self, given: bool) -> None:
        """Raises InputError for what makes no sense, `given` recordings or none."""
        for name in ("camera", "actions", "control_hz"):
            if getattr(self, name) is not None and not given:
                raise InputError(f"{flag(name)} goes with recordings only")
        if self.control_hz is not None and not 0.01 <= self.control_hz <= 1000:
            raise InputError(f"--control-hz must lie in [0.01, 1000], got {self.control_hz:g}")


@dataclass(frozen=True, kw_only=True)
class Observes:
    """What of it is looked at; a command that does not ask looks at pictures alone."""

    observe: str | None = None
    """What to look at, NAME,NAME,...: `cameras`, `joints` (all sensors), or cameras and sensors by
    name; by default all that the tuning file declares, and of a built-in task its camera alone."""

    @property
    def observed(self) -> tuple[str, ...] | None:
        if self.observe is None:
            return None
        return tuple(name.strip() for name in self.observe.split(","))


@dataclass(frozen=True, kw_only=True)
class ObservesSized(Observes):
    """The same, and how large pictures are."""

    image_size: int | None = None
    """Pixels of the height at which pictures are looked at; by default 64, or 100 by the paper's
    search. Time grows with its square."""

    def check_image_size(self) -> None:
        """Raises InputError for one that no search can look at."""
        if self.image_size is not None and not _SMALLEST_PX <= self.image_size <= _LARGEST_PX:
            raise InputError(
                f"--image-size must lie in [{_SMALLEST_PX}, {_LARGEST_PX}], got {self.image_size}"
            )


@dataclass(frozen=True, kw_only=True)
class RealConfig(RecordingsConfig):
    """Which real world, and from how far away its parameters are searched."""

    real: str = "pseudo"
    """The real world: `pseudo`, a simulated one that is filmed and scored against, recordings of
    video and actions (a LeRobotDataset v3 or v2, pairs of mp4 and csv, or HDF5:
    docs/recordings.md), or a robot: `xarm`, `lerobot`."""
    robot: Path | None = None
    """With `xarm` and `lerobot`: a TOML file of the robot, its limits and its camera."""
    move: bool = False
    """Let the robot move; without it a dry run says what would be in the way (docs/robot.md)."""
    real_parameters: Path | None = None
    """With `pseudo`: a JSON object of true values, {name: value}; by default all are nominal."""
    start_factor: float = 2.0
    """With `pseudo`: the factor by which every parameter is too high or too low at the start."""
    real_gap: bool = False
    """With `pseudo`: another renderer, video compression, camera noise and actions that come a
    step late stand between the simulator and that world, for a policy too. Needs OpenGL."""
    known_colour: str | None = None
    """A colour of the task that is known, such as a grey card's: NAME, where it is as the model
    has it, or NAME=R,G,B from 0 to 1; several after `;`. By it the camera's gain and white balance
    are found, and so the other colours."""
    seed: int = 0
    """Of all random numbers; with `pseudo` it also chooses which parameters start too high."""

    def check_real(self) -> None:
        """Raises InputError for what makes no sense."""
        self.check_recordings(self.real not in ("pseudo", *ROBOTS))
        if self.real not in ROBOTS and (self.robot is not None or self.move):
            raise InputError("--robot and --move go with --real xarm or lerobot only")
        if self.real in ROBOTS and self.robot is None:
            raise InputError(f"--real {self.real} needs --robot FILE.toml (see docs/robot.md)")
        if self.real != "pseudo" and self.real_parameters is not None:
            raise InputError("--real-parameters goes with --real pseudo only")
        if self.real != "pseudo" and self.start_factor != RealConfig.start_factor:
            raise InputError("--start-factor goes with --real pseudo only")
        if self.real_gap and self.real != "pseudo":
            raise InputError("--real-gap goes with --real pseudo only")
        if not self.start_factor >= 1:
            raise InputError(f"--start-factor must be at least 1, got {self.start_factor:g}")
        check_seed(self.seed)
