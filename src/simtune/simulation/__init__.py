"""Simulated worlds: batched physics, and two renderers behind one interface."""

from simtune.simulation.delays import remember_controls
from simtune.simulation.quality import OPENGL_DM_CONTROL, OPENGL_FAST, OpenGLQuality
from simtune.simulation.renderer import Renderer, RendererName, make_renderer
from simtune.simulation.simulator import Rollouts, Simulator, random_actions
from simtune.simulation.worlds import Worlds

__all__ = [
    "OPENGL_DM_CONTROL",
    "OPENGL_FAST",
    "OpenGLQuality",
    "Renderer",
    "RendererName",
    "Rollouts",
    "Simulator",
    "Worlds",
    "make_renderer",
    "random_actions",
    "remember_controls",
]
