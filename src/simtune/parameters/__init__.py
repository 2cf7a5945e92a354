"""What is tuned: parameters by name, their space, and how they are written into models."""

from simtune.parameters.model_writer import ModelWriter
from simtune.parameters.parameter import Parameter, colour, dynamics
from simtune.parameters.space import ParameterSpace

__all__ = ["ModelWriter", "Parameter", "ParameterSpace", "colour", "dynamics"]
