"""The options of `simtune record`, `simtune export` and `simtune compare`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.checks import at_least, check_seed, flag
from simtune.config.prints import Prints
from simtune.errors import InputError
from simtune.names import ExportFormat, RendererName

_LARGEST_PX = 1024  # a whole episode is held in memory until it is written


@dataclass(frozen=True, kw_only=True)
class RecordConfig(Prints):
    """Film a simulated world as a LeRobotDataset v3: video and actions."""

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    out: Path
    """The dataset's folder, which must be new or empty."""
    episodes: int = 10
    """Number of episodes."""
    parameters: Path | None = None
    """A JSON file of the world's parameters, {name: value}; missing ones are nominal."""
    policy: str = "random"
    """Source of the actions: `random`, a folder that `simtune train` wrote, or `scripted`: the
    task's script, if it has one, which uses the simulator's state."""
    renderer: RendererName = "raycaster"
    """raycaster: pictures as in tuning; opengl: with shadows, reflections and smooth edges."""
    image_size: int = 128
    """Height of the pictures in pixels, an even number."""
    width: int | None = None
    """Width of the pictures in pixels, an even number; by default they are square. With a region
    they have the shape of the whole picture."""
    seed: int = 0
    """Random seed of the actions and of the initial states."""

    def check(self) -> None:
        """Raises InputError for invalid options."""
        at_least(self, 1, "episodes")
        check_seed(self.seed)
        for name, pixels in (("image_size", self.image_size), ("width", self.width)):
            if pixels is not None and (not 16 <= pixels <= _LARGEST_PX or pixels % 2):
                raise InputError(
                    f"{flag(name)} must be an even number from 16 to {_LARGEST_PX}, got {pixels}"
                )


@dataclass(frozen=True, kw_only=True)
class ExportConfig(Prints):
    """Export a run's result: the tuned MJCF, its parameters, and Python code that applies them.

    Writes model.xml with the files it refers to, parameters.json and apply.py into OUT. With
    --samples, also writes draws of the posterior for domain randomisation: samples.csv.
    """

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune tune` or `simtune train` wrote."""
    out: Path
    """The folder to write, which must be new or empty; with --samples it may be a new file
    NAME.csv, NAME.npz or NAME.json, to write only the draws."""
    samples: int | None = None
    """Number of worlds to draw from the joint posterior of all parameters."""
    format: ExportFormat = "samples"
    """A training library for which to write the draws as well, mjlab or MuJoCo Playground: as
    worlds.npz, with a Python module that randomises environments with them."""

    def check(self) -> None:
        """Raises InputError for invalid options."""
        at_least(self, 1, "samples")
        if self.format != "samples" and (self.samples is None or self.is_file):
            raise InputError(f"--format {self.format} needs --samples, and a folder as --out")
        if self.is_file and self.samples is None:
            raise InputError(f"--out {self.out} is for --samples; without them give a folder")
        if self.is_file and self.out.exists():
            raise InputError(f"{self.out} is there already: give --out another name")
        if self.out.is_dir() and any(self.out.iterdir()):
            raise InputError(f"{self.out} is not empty: give --out a new or an empty folder")

    @property
    def is_file(self) -> bool:
        """Whether only the draws are written, to a file."""
        return self.out.suffix in (".csv", ".npz", ".json")


@dataclass(frozen=True, kw_only=True)
class CompareConfig(Prints):
    """Test whether runs agree, for example on two sets of episodes of the same real world.

    All runs must have tuned the same parameters by --search posterior. Writes nothing.
    """

    run_folders: Annotated[Positional[tuple[Path, ...]], arg(metavar="RUN RUN ...")]
    """At least two folders that `simtune tune` or `simtune train` wrote."""

    def check(self) -> None:
        """Raises InputError for a single run."""
        if len(self.run_folders) < 2:
            raise InputError("two runs at least can be compared: give their folders")
