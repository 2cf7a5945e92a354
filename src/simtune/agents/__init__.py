"""What acts, by name; add an agent by a file here and a line in `make_agent`."""

import numpy as np
import torch

from simtune.agents.agent import Agent, Seen
from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.agents.drqv2 import DrqV2, DrqV2Config
from simtune.agents.teacher_student import TeacherStudent


def make_agent(
    name: str,
    *,
    image_size: int,
    num_stacked: int,
    num_keypoints: int,
    num_states: int,
    num_positions: int,
    num_actions: int,
    knows: np.ndarray,
    total_steps: int,
    first_tried: int,
    round_steps: int,
    seed: int,
    device: torch.device | str,
) -> Agent:
    """An agent that acts on `num_stacked` square pictures of `image_size` pixels a side.

    States are `num_positions` positions, then velocities.
    `knows`, (N,) bool: parameters that may be told to whoever knows the state.
    `total_steps`: of the whole training, for what changes in its course; `first_tried`: after so
    many of them it is tried out in the real world; `round_steps`: between two updates.
    """
    if name == "teacher_student":
        return TeacherStudent(
            image_size=image_size,
            num_stacked=num_stacked,
            num_keypoints=num_keypoints,
            num_states=num_states,
            num_positions=num_positions,
            num_actions=num_actions,
            knows=knows,
            total_steps=total_steps,
            first_tried=first_tried,
            round_steps=round_steps,
            seed=seed,
            device=device,
        )
    if name == "drqv2":
        noise_steps = max(1, total_steps // 2)
        config = DrqV2Config(
            image_size=image_size, num_stacked=num_stacked, noise_steps=noise_steps
        )
        return DrqV2(num_actions, config, seed=seed, device=device)
    assert name == "curl_sac", name
    crop_size = round(0.84 * image_size)  # 84 of 100
    config = CurlSacConfig(image_size=image_size, crop_size=crop_size, num_stacked=num_stacked)
    return CurlSac(num_actions, config, seed=seed, device=device)


__all__ = ["Agent", "Seen", "make_agent"]
