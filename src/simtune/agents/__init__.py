"""Agents by name; add one with a file here and a line in `make_agent`."""

from simtune.agents.agent import Agent, AgentSpec, Observation
from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.agents.teacher_student import TeacherStudent
from simtune.networks.pixel_encoder import crop_of


def make_agent(name: str, spec: AgentSpec) -> Agent:
    """The agent with this name: teacher_student or curl_sac."""
    if name == "teacher_student":
        return TeacherStudent(spec)
    assert name == "curl_sac", name
    size = spec.image_size
    config = CurlSacConfig(image_size=size, crop_size=crop_of(size), num_stacked=spec.num_stacked)
    return CurlSac(spec.num_actions, config, seed=spec.seed, device=spec.device)


__all__ = ["Agent", "AgentSpec", "Observation", "make_agent"]
