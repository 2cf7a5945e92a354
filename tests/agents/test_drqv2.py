"""DrQ-v2: its target values and noise by hand, and what its actor may not move."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from batches import pixel_batch

from simtune.agents.drqv2 import DrqV2, DrqV2Config
from simtune.replay import Replay
from simtune.tasks import load_task

SMALL = DrqV2Config(
    image_size=16,
    num_stacked=2,
    pad=2,
    hidden_size=32,
    batch_size=4,
    random_steps=0,
    update_every=1,
    noise_steps=1000,
)
SPACE = load_task("cartpole").parameters


@pytest.fixture
def agent() -> DrqV2:
    return DrqV2(2, SMALL, seed=0)


def test_default_networks_have_the_papers_shapes():
    agent = DrqV2(6, seed=0)
    of_actor = [tuple(p.shape) for p in agent.actor.parameters() if p.ndim > 1]
    assert of_actor == [(50, 32 * 35 * 35), (1024, 50), (1024, 1024), (6, 1024)]


def test_target_q_equals_hand_calculation(agent, monkeypatch):
    values = torch.tensor([[3.0, 5.0, -1.0], [4.0, 1.0, -2.0]])
    monkeypatch.setattr(agent.target, "forward", lambda obs, actions: values)
    target_q = agent.target_q(
        torch.tensor([1.0, 2.0, 0.5]),
        torch.tensor([1.0, 0.0, 1.0]),  # the second step ended the task
        torch.rand(3, agent.encoder.num_outputs),
    )
    np.testing.assert_allclose(target_q.detach(), [1 + 0.99 * 3, 2, 0.5 - 0.99 * 2], rtol=1e-6)


def test_target_q_is_of_the_actors_actions_with_clipped_noise(agent, monkeypatch):
    seen = []
    monkeypatch.setattr(agent.target, "forward", lambda _, a: seen.append(a) or a.T)
    monkeypatch.setattr(agent.actor, "forward", lambda _: torch.full((500, 2), 0.5))
    agent.target_q(torch.zeros(500), torch.ones(500), torch.empty(500, 0))
    off = seen[0] - 0.5
    assert float(off.abs().max()) == pytest.approx(0.3, abs=1e-6)
    assert ((off.abs() - 0.3).abs() < 1e-6).float().mean() > 0.5  # noise of 1 is mostly clipped


def test_noise_falls_with_the_steps_collected_until_its_last_value():
    agent = DrqV2(2, replace(SMALL, update_every=100_000), seed=0)
    replay = Replay(SPACE, filmed_capacity=1)  # left alone: no update is due yet
    noises = [agent.noise]
    for num_steps in (250, 250, 500, 10_000):
        agent.update(replay, num_steps)
        noises.append(agent.noise)
    assert noises == pytest.approx([1.0, 0.775, 0.55, 0.1, 0.1])


def test_the_actors_loss_has_no_gradient_in_the_encoder(agent, monkeypatch):
    agent.learn(pixel_batch(SMALL.image_size))
    for module in (agent.encoder, agent.critic, agent.target):
        module.zero_grad(set_to_none=True)
    monkeypatch.setattr("simtune.agents.drqv2.descend", lambda loss, optimizer: losses.append(loss))
    losses: list[torch.Tensor] = []
    agent.learn(pixel_batch(SMALL.image_size))
    of_encoder = torch.autograd.grad(losses[1], [*agent.encoder.parameters()], allow_unused=True)
    assert of_encoder == (None,) * 8


def test_one_update_moves_each_part_once(agent):
    parts = (agent.encoder, agent.critic, agent.actor, agent.target)
    before = [[p.detach().clone() for p in part.parameters()] for part in parts]
    agent.learn(pixel_batch(SMALL.image_size))
    for part, old in zip(parts, before, strict=True):
        for was, now in zip(old, part.parameters(), strict=True):
            assert not torch.equal(was, now)
    for was, now, online in zip(
        before[3], agent.target.parameters(), agent.critic.parameters(), strict=True
    ):
        torch.testing.assert_close(now.detach(), 0.99 * was + 0.01 * online.detach())
