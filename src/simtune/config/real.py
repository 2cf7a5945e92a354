"""Options of commands that read recordings or use a real world."""

from dataclasses import dataclass
from pathlib import Path

from simtune.config.option_checks import check_device, check_seed, flag, usual_without
from simtune.errors import InputError

ROBOTS = ("xarm", "lerobot")
NO_RECORDINGS = ("pseudo", *ROBOTS)  # values of --real that are no path
_SMALLEST_PX, LARGEST_PX = 32, 256


@dataclass(frozen=True, kw_only=True)
class RecordingsConfig:
    """Options for reading recordings (docs/recordings.md), and for what is observed."""

    camera: str | None = None
    """The recordings' camera, such as observation.images.front; needed if there are several."""
    actions: str | None = None
    """The recordings' actions to use, NAME,NAME,..., in the order of the model's actions; by
    default all."""
    control_hz: float | None = None
    """Steps per second to which recordings are resampled; by default their own rate."""
    leave_out: str | None = None
    """Recorded episodes that are not used, NAME,NAME,..., as messages call them: 3 for `episode 3`,
    demo_3, swing3."""
    observe: str | None = None
    """What to observe, NAME,NAME,...: `cameras`, `joints` (all sensors), or names of cameras and
    sensors; by default everything that a tuning file declares, and a built-in task's camera."""

    @property
    def action_names(self) -> tuple[str, ...] | None:
        return _names(self.actions)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the episodes that are not used."""
        return _names(self.leave_out) or ()

    @property
    def observed(self) -> tuple[str, ...] | None:
        """Names of the observed cameras and sensors; None: the default of `observe`."""
        return _names(self.observe)

    def check_recordings(self, given: bool) -> None:
        """Raises InputError for invalid options; `given`: whether there are recordings."""
        for name in ("camera", "actions", "control_hz", "leave_out"):
            if getattr(self, name) is not None and not given:
                raise InputError(f"{flag(name)} goes with recordings only")
        if self.control_hz is not None and not 0.01 <= self.control_hz <= 1000:
            raise InputError(f"--control-hz must lie in [0.01, 1000], got {self.control_hz:g}")


@dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """The size of pictures."""

    image_size: int | None = None
    """Height of pictures in pixels; by default 100 for the paper's search, else 64, or up to 128 if
    what moves is small. The time grows with its square."""

    def check_image_size(self) -> None:
        """Raises InputError if the size is too small or too large."""
        if self.image_size is not None and not _SMALLEST_PX <= self.image_size <= LARGEST_PX:
            raise InputError(
                f"--image-size must lie in [{_SMALLEST_PX}, {LARGEST_PX}], got {self.image_size}"
            )


@dataclass(frozen=True, kw_only=True)
class RealConfig(RecordingsConfig):
    """Options of the real world, and of the search's start."""

    real: str = "pseudo"
    """The real world: `pseudo` (a simulated one, whose truth gives a score), recordings of video
    and actions (a LeRobotDataset v3 or v2, HDF5, or a folder of NAME.npz, or of pairs of mp4 and
    csv: docs/recordings.md), or a robot: `xarm`, `lerobot`."""
    robot: Path | None = None
    """With `xarm` and `lerobot`: a TOML file of the robot, its limits and its camera."""
    move: bool = False
    """Let the robot move; without it, a dry run tells what would prevent moving
    (docs/robot.md)."""
    real_parameters: Path | None = None
    """With `pseudo`: a JSON file of true values, {name: value}; by default all are nominal."""
    start_factor: float = 2.0
    """With `pseudo`: the factor by which every parameter is too high or too low at the start."""
    real_gap: bool = False
    """With `pseudo`: make that world differ from the simulator, for a policy too: another renderer,
    video compression, camera noise, and actions one step late. Needs OpenGL."""
    known_colour: str | None = None
    """A known colour of the task, such as a grey card's: NAME, if the model has the right value, or
    NAME=R,G,B from 0 to 1; several separated by `;`. The camera's gain and white balance are
    estimated from it, which reveals the other colours."""
    device: str = "auto"
    """Device of networks and of the simulator's pictures: auto (cuda where there is one), cpu, cuda
    or cuda:N."""
    seed: int = 0
    """Seed of all random numbers; with `pseudo` it also chooses which parameters start too high."""

    @property
    def has_search(self) -> bool:
        """Whether a search looks at the real world."""
        return True

    def check_real(self) -> None:
        """Raises InputError for invalid options."""
        self.check_recordings(self.real not in NO_RECORDINGS)
        if self.real not in ROBOTS and (self.robot is not None or self.move):
            raise InputError("--robot and --move go with --real xarm or lerobot only")
        if self.real in ROBOTS and self.robot is None:
            raise InputError(f"--real {self.real} needs --robot FILE.toml (see docs/robot.md)")
        if self.real != "pseudo":
            own = ("real_parameters", "start_factor", "real_gap")
            usual_without(self, "--real pseudo only", *own)
        if not self.start_factor >= 1:
            raise InputError(f"--start-factor must be at least 1, got {self.start_factor:g}")
        check_device(self.device)
        check_seed(self.seed)


def _names(listed: str | None) -> tuple[str, ...] | None:
    """The names in NAME,NAME,..."""
    return None if listed is None else tuple(name.strip() for name in listed.split(","))
