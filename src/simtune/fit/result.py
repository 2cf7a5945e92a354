"""What a fit finds, and how well it fits."""

from dataclasses import dataclass

import numpy as np

# Of physics and of appearance, in unit coordinates: 2 % of a value, and what a camera's brightness
# and tint, shadows and highlights make of a colour. Assumed, as no simulator can tell them.
_DISCREPANCY = (0.005, 0.035)


@dataclass(frozen=True)
class Misfit:
    """How badly videos fit a simulator; larger is worse."""

    motion_px: (
        float  # distance between where the detector is sure a keypoint is and where it should be
    )
    picture: float  # noise of a pixel, of the full scale


@dataclass(frozen=True)
class FitResult:
    """Parameters (N,) as fitted, with their standard deviations in unit coordinates."""

    parameters: np.ndarray
    std: np.ndarray  # (N,)
    correlation: np.ndarray  # (P, P) between the fitted parameters that are no mere appearance
    moving: np.ndarray  # (P,) which those are
    misfit: Misfit
    start: np.ndarray  # (S,) the state in which the first episode began
    lag: int  # steps by which the actions seem to come late

    @property
    def is_moving(self) -> np.ndarray:
        """(N,) bool."""
        return np.isin(np.arange(len(self.std)), self.moving)

    def discrepancy(self, looks_alike: bool) -> np.ndarray:
        """(N,) standard deviations of what is wrong with every picture alike, and no fit can see.

        Only a real world that `looks_alike` to the simulator has nothing of it.
        """
        return np.where(self.is_moving, *_DISCREPANCY) * (not looks_alike)
