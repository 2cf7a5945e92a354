"""Agents by name; add one with a file here and a line in `AGENTS`."""

from collections.abc import Callable

from simtune.agents.agent import Agent, AgentSpec, Observation
from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.agents.teacher_student import TeacherStudent
from simtune.names import AgentName
from simtune.networks.pixel_encoder import crop_of


def _curl_sac(spec: AgentSpec) -> Agent:
    size = spec.image_size
    config = CurlSacConfig(image_size=size, crop_size=crop_of(size), num_stacked=spec.num_stacked)
    return CurlSac(spec.num_actions, config, seed=spec.seed, device=spec.device)


AGENTS: dict[AgentName, Callable[[AgentSpec], Agent]] = {
    "teacher_student": TeacherStudent,
    "curl_sac": _curl_sac,
}


def make_agent(name: AgentName, spec: AgentSpec) -> Agent:
    """The agent with this name."""
    return AGENTS[name](spec)


__all__ = ["AGENTS", "Agent", "AgentSpec", "Observation", "make_agent"]
