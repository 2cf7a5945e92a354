"""What is tuned: parameters by name, their space, and how they are written into models."""

from simtune.parameters.accuracy import percent_error
from simtune.parameters.declare import camera_pose, colour, dynamics, field_of_view
from simtune.parameters.field_index import rows_of
from simtune.parameters.fields import field_of
from simtune.parameters.model_writer import ModelWriter
from simtune.parameters.parameter import Parameter
from simtune.parameters.space import ParameterSpace

__all__ = [
    "ModelWriter",
    "Parameter",
    "ParameterSpace",
    "camera_pose",
    "colour",
    "dynamics",
    "field_of",
    "field_of_view",
    "percent_error",
    "rows_of",
]
