"""The options of `simtune record` and `simtune export`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.checks import at_least, check_seed
from simtune.errors import InputError
from simtune.names import RendererName

_LARGEST_PX = 1024  # an episode is kept whole until it is written


@dataclass(frozen=True, kw_only=True)
class RecordConfig:
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
    """Pixels a side of the square pictures, an even number."""
    seed: int = 0
    """Of the actions and of where episodes start."""

    def check(self) -> None:
        """Raises InputError for numbers that make no sense."""
        at_least(self, 1, "episodes")
        check_seed(self.seed)
        if not 16 <= self.image_size <= _LARGEST_PX or self.image_size % 2:
            raise InputError(
                f"--image-size must be an even number from 16 to {_LARGEST_PX}, "
                f"got {self.image_size}"
            )


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """Take what a run found along: the tuned MJCF, its numbers, and Python that applies them.

    Writes model.xml, with the files that it refers to, parameters.json and apply.py into OUT.
    """

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune tune` or `simtune train` wrote."""
    out: Path
    """The folder to write, which must not be there yet, or be empty."""
