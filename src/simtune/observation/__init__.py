"""Observations of the real world: its cameras, and sensors of joints.

The real world owns an `ObservationModel` and hands it down. Only this says whether pictures are the
simulator's own, how late actions may take effect and how large the discrepancy is. A fit asks the
`Evidence` of each sensor for residuals and likelihoods, and does not know any particular sensor.
"""

from simtune.observation.evidence import AllEvidence
from simtune.observation.joint_readings import JointReadings
from simtune.observation.joints import (
    JointSensor,
    Quantity,
    advanced,
    assumed_noise,
    by_column,
    columns_of,
    declared_noise,
    finds_offset,
    measured_places,
    units_of,
)
from simtune.observation.model import ObservationModel

__all__ = [
    "AllEvidence",
    "JointReadings",
    "JointSensor",
    "ObservationModel",
    "Quantity",
    "advanced",
    "assumed_noise",
    "by_column",
    "columns_of",
    "declared_noise",
    "finds_offset",
    "measured_places",
    "units_of",
]
