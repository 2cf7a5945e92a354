"""The options of `simtune evaluate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.option_checks import at_least, check_seed, usual_without
from simtune.config.prints import Prints


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig(Prints):
    """Score a run on other episodes. Writes nothing.

    For a run of `train`: scores its policy, in its pseudo-real world or in another simulated one,
    as one JSON object.
    For a run of `tune` whose tuning file has [[sensors]], also one of video alone: --real replays
    other recordings open loop, each from its first readings, in the simulator before and after
    tuning.
    """

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune train` or `simtune tune` wrote."""
    real: Path | None = None
    """For a run of `tune`: recordings with readings of its [[sensors]], to replay in its simulator.
    """
    parameters: Path | None = None
    """A JSON file of the parameters of the world to score in, {name: value}, or a run's
    result.json; by default those of the pseudo-real world."""
    episodes: int | None = None
    """Number of episodes: by default 20, or all recordings."""
    seed: int = 1000
    """Random seed of the episodes. The training's seed repeats those of its own score, if as many
    are played: --episodes as its --scored-episodes, 10 by default."""

    def check(self) -> None:
        """Raises InputError for invalid options."""
        if self.real:
            usual_without(self, "a run of train, and not with --real", "parameters", "seed")
        at_least(self, 1, "episodes")
        check_seed(self.seed)
