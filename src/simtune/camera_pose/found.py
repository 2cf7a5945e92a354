"""A camera that was found, and what a lens would change."""

from typing import NamedTuple

import numpy as np

from simtune.camera_pose.tracking import Agreement, CameraFit


class Bend(NamedTuple):
    """A fit with one more unknown: k1 of a lens, on top of the declared distortion."""

    fit: CameraFit  # of P + 1 parameters, k1 the last
    k1: float
    k1_std: float
    k1_range: float  # that the last unit coordinate spans
    k1_usual: float  # standard deviation of what is usual for such a lens

    @property
    def camera(self) -> CameraFit:
        """The fit's camera alone, of P parameters."""
        return self.fit._replace(unit=self.fit.unit[:-1], slopes=self.fit.slopes[:, :-1])


class FoundCamera(NamedTuple):
    """A camera, and the ends of all fits that are about as good, including its own."""

    fit: CameraFit
    agreement: Agreement
    ends: np.ndarray  # (K, P) unit coordinates
    bend: Bend | None = None  # None: not tried
    is_bent: bool = False  # whether a lens explains the film clearly better; then `fit` is with it
