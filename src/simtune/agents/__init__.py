"""Agents by name; add one with a file here and a line in `make_agent`."""

from simtune.agents.agent import Agent, AgentSpec, Observation
from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.agents.drqv2 import DrqV2, DrqV2Config
from simtune.agents.teacher_student import TeacherStudent
from simtune.networks.pixel_encoder import crop_of


def make_agent(name: str, spec: AgentSpec) -> Agent:
    """The agent with this name: teacher_student, drqv2 or curl_sac."""
    if name == "teacher_student":
        return TeacherStudent(spec)
    size, num_stacked = spec.image_size, spec.num_stacked
    if name == "drqv2":
        noise_steps = max(1, spec.total_steps // 2)
        config = DrqV2Config(image_size=size, num_stacked=num_stacked, noise_steps=noise_steps)
        return DrqV2(spec.num_actions, config, seed=spec.seed, device=spec.device)
    assert name == "curl_sac", name
    config = CurlSacConfig(image_size=size, crop_size=crop_of(size), num_stacked=num_stacked)
    return CurlSac(spec.num_actions, config, seed=spec.seed, device=spec.device)


__all__ = ["Agent", "AgentSpec", "Observation", "make_agent"]
