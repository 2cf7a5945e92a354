"""True parameters of the pseudo-real world, used to choose a search's start and to score it."""

import hashlib

import numpy as np

from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace, percent_error
from simtune.random_streams import Purpose, stream
from simtune.randomization import size_of
from simtune.real.gap import RealityGap
from simtune.real.pseudo import PseudoReal
from simtune.simulation import AnySimulator


class Truth:
    """Known in a pseudo-real world only, and never given to a search."""

    def __init__(self, space: ParameterSpace, parameters: np.ndarray):
        self._space, self._parameters = space, (known := np.asarray(parameters, float))
        # Reveals whether the truth has changed, but not its values
        self.digest = hashlib.sha256(known.tobytes()).hexdigest()[:16]

    def make_real(
        self,
        simulator: AnySimulator,
        *,
        episode_steps: int,
        seed: int,
        gap: RealityGap | None = None,
        observation: ObservationModel | None = None,
    ) -> PseudoReal:
        """The world of these parameters; it gives observations and actions only."""
        return PseudoReal(
            simulator,
            self._parameters,
            episode_steps=episode_steps,
            seed=seed,
            gap=gap,
            observation=observation,
        )

    def wrong_start(self, seed: int, factor: float = 2.0) -> np.ndarray:
        """(N,) parameters, each at random the true value times `factor` or divided by it.

        The default, twice or half the truth, is as in Sec. VI-A. Where one of these is beyond a
        bound, as of a colour above .5, it is the other; the paper's colours stop at 1 instead, so
        that some start at their truth. What may be negative, or is 0, starts a part of its range
        away: half of `size_of`.
        """
        space, real = self._space, self._parameters
        is_high = stream(seed, Purpose.WRONG_START).random(len(space)) < 0.5
        away = size_of(space, real) / 2
        has_no_factor = (space.low < 0) | (real == 0)
        above = np.where(has_no_factor, real + away, real * factor)
        below = np.where(has_no_factor, real - away, real / factor)
        is_high = np.where(above > space.high, False, np.where(below < space.low, True, is_high))
        return space.clip(np.where(is_high, above, below))

    def for_oracle(self) -> np.ndarray:
        """(N,) the truth, for the oracle's world and for scoring a trained policy."""
        return self._parameters.copy()

    def score(self, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) the truth, and (N,) the percent error of an estimate (N,); see `percent_error`."""
        real, space = self._parameters, self._space
        farthest = np.maximum(np.abs(space.low), np.abs(space.high))
        return real.copy(), percent_error(mean, real, farthest)
