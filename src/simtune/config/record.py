"""The options of `simtune record`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.option_checks import at_least, check_seed, flag
from simtune.config.prints import Prints
from simtune.errors import InputError
from simtune.names import RendererName

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
