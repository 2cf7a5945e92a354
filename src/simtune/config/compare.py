"""The options of `simtune compare`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.prints import Prints
from simtune.errors import InputError


@dataclass(frozen=True, kw_only=True)
class CompareConfig(Prints):
    """Test whether runs agree, for example on two sets of episodes of the same real world.

    Of runs by --search posterior, what all of them tuned is compared. Writes nothing.
    """

    run_folders: Annotated[Positional[tuple[Path, ...]], arg(metavar="RUN RUN ...")]
    """At least two folders that `simtune tune` or `simtune train` wrote."""

    def check(self) -> None:
        """Raises InputError for a single run."""
        if len(self.run_folders) < 2:
            raise InputError("two runs at least can be compared: give their folders")
