"""What is observed of the real world: its cameras, and what is measured besides.

The real world owns an `ObservationModel` and hands it down; it alone says whether pictures are the
simulator's own, how late actions may take effect and how wrong any picture may be. A fit asks the
`Evidence` of each sensor for residuals and likelihoods, and knows of no sensor in particular.
"""

from simtune.observation.evidence import AllEvidence, Evidence
from simtune.observation.joint_readings import JointReadings
from simtune.observation.joints import (
    JointSensor,
    declared_noise,
    finds_offset,
    joints_of,
    read_later,
    units_of,
    usual_noise,
)
from simtune.observation.model import Camera, ObservationModel, Sensor

__all__ = [
    "AllEvidence",
    "Camera",
    "Evidence",
    "JointReadings",
    "JointSensor",
    "ObservationModel",
    "Sensor",
    "declared_noise",
    "finds_offset",
    "joints_of",
    "read_later",
    "units_of",
    "usual_noise",
]
