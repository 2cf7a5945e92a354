"""The options of `simtune record`, `simtune export` and `simtune compare`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.checks import at_least, check_seed, flag
from simtune.config.prints import Prints
from simtune.errors import InputError
from simtune.names import ExportFormat, RendererName

_LARGEST_PX = 1024  # an episode is kept whole until it is written


@dataclass(frozen=True, kw_only=True)
class RecordConfig(Prints):
    """Film a world into a LeRobotDataset v3: video and the actions behind it."""

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    out: Path
    """The dataset's folder, which must not be there yet, or be empty."""
    episodes: int = 10
    """How many episodes."""
    parameters: Path | None = None
    """A JSON object of the world's parameters, {name: value}; those missing are nominal."""
    policy: str = "random"
    """Who acts: `random`, a folder that `simtune train` wrote, or `scripted`: by what only a
    simulator knows, for tasks that have such a script."""
    renderer: RendererName = "raycaster"
    """raycaster: as the simulator sees; opengl: with shadows, reflections and smooth edges."""
    image_size: int = 128
    """Pixels of the pictures' height, an even number."""
    width: int | None = None
    """The same of their width; by default they are square."""
    seed: int = 0
    """Of the actions and of where episodes start."""

    def check(self) -> None:
        """Raises InputError for numbers that make no sense."""
        at_least(self, 1, "episodes")
        check_seed(self.seed)
        for name, pixels in (("image_size", self.image_size), ("width", self.width)):
            if pixels is not None and (not 16 <= pixels <= _LARGEST_PX or pixels % 2):
                raise InputError(
                    f"{flag(name)} must be an even number from 16 to {_LARGEST_PX}, got {pixels}"
                )


@dataclass(frozen=True, kw_only=True)
class ExportConfig(Prints):
    """Take what a run found along: the tuned MJCF, its numbers, and Python that applies them.

    Writes model.xml, with the files that it refers to, parameters.json and apply.py into OUT. With
    --samples also draws of the posterior, for domain randomisation: samples.csv.
    """

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune tune` or `simtune train` wrote."""
    out: Path
    """The folder to write, which must not be there yet, or be empty; with --samples also a file to
    write them alone to, NAME.csv, NAME.npz or NAME.json."""
    samples: int | None = None
    """How many worlds to draw from the joint posterior: what is known, and how it goes together."""
    format: ExportFormat = "samples"
    """What else draws are written for: the training of mjlab or of MuJoCo Playground, into
    worlds.npz, beside a Python module that randomises environments by them."""

    def check(self) -> None:
        """Raises InputError for what makes no sense."""
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
        """Whether draws are all that is asked for."""
        return self.out.suffix in (".csv", ".npz", ".json")


@dataclass(frozen=True, kw_only=True)
class CompareConfig(Prints):
    """Say whether runs agree, such as of two sets of episodes of one real world.

    All must have tuned the same parameters by the search that gives intervals. Writes nothing.
    """

    run_folders: Annotated[Positional[tuple[Path, ...]], arg(metavar="RUN RUN ...")]
    """Folders that `simtune tune` or `simtune train` wrote, two at least."""

    def check(self) -> None:
        """Raises InputError for a single run."""
        if len(self.run_folders) < 2:
            raise InputError("two runs at least can be compared: give their folders")
