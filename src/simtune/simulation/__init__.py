"""Simulated worlds: batched physics, and two renderers behind one interface."""

from simtune.simulation.acting import PixelPolicy, Projector, on_pictures, scale_actions
from simtune.simulation.actions import (
    ActionMapping,
    DirectActions,
    JointActions,
    MapActions,
    ScaledActions,
)
from simtune.simulation.delays import count_substeps, remember_controls
from simtune.simulation.environment import EnvironmentSimulator, Points
from simtune.simulation.mocap import MocapActions
from simtune.simulation.played import Act, AnySimulator, Played, Rollouts, random_actions
from simtune.simulation.quality import OPENGL_DM_CONTROL, OPENGL_FAST, OpenGLQuality
from simtune.simulation.renderer import Renderer, RendererName, make_renderer
from simtune.simulation.simulator import Script, Simulator
from simtune.simulation.states import StateSpace
from simtune.simulation.worlds import Worlds

__all__ = [
    "OPENGL_DM_CONTROL",
    "OPENGL_FAST",
    "Act",
    "ActionMapping",
    "AnySimulator",
    "DirectActions",
    "EnvironmentSimulator",
    "JointActions",
    "MapActions",
    "MocapActions",
    "OpenGLQuality",
    "PixelPolicy",
    "Played",
    "Points",
    "Projector",
    "Renderer",
    "RendererName",
    "Rollouts",
    "ScaledActions",
    "Script",
    "Simulator",
    "StateSpace",
    "Worlds",
    "count_substeps",
    "make_renderer",
    "on_pictures",
    "random_actions",
    "remember_controls",
    "scale_actions",
]
