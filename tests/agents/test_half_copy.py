"""Weights in bfloat16 beside those in float32 that learn."""

import numpy as np
import pytest
import torch
from batches import pixel_batch
from test_curl_sac import SMALL
from torch import nn

from simtune.agents.curl_sac import CurlSac
from simtune.agents.half_copy import HalfCopy
from simtune.agents.pixel_networks import TwinQ, descend
from simtune.networks.layers import autocast

CPU = torch.device("cpu")


@pytest.fixture
def fast_bf16(monkeypatch):
    monkeypatch.setattr("simtune.networks.layers.has_fast_bf16", lambda device: True)


def twin() -> TwinQ:
    torch.manual_seed(0)
    return TwinQ(3, 2, 16)


def test_where_bfloat16_is_not_faster_the_network_is_used_itself(monkeypatch):
    monkeypatch.setattr("simtune.networks.layers.has_fast_bf16", lambda device: False)
    network = twin()
    assert HalfCopy(network, CPU).used is network


@pytest.mark.usefixtures("fast_bf16")
def test_matrices_are_half_but_for_the_last_layer():
    layers = [part for part in HalfCopy(twin(), CPU).used.modules() if isinstance(part, nn.Linear)]
    assert [layer.weight.dtype for layer in layers] == 2 * [
        torch.bfloat16,
        torch.bfloat16,
        torch.float32,
    ]


@pytest.mark.usefixtures("fast_bf16")
def test_a_step_is_that_of_autocast():
    plain, network = twin(), twin()
    half = HalfCopy(network, CPU)
    seen, actions = torch.randn(64, 3), torch.randn(64, 2)
    for model, used, copies in ((plain, plain, ()), (network, half.used, (half,))):
        optimizer = torch.optim.SGD(model.parameters(), 0.1)
        with autocast(CPU):
            loss = used(seen, actions).square().mean()
        descend(loss, optimizer, *copies)
    for ours, theirs in zip(network.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs)


@pytest.mark.usefixtures("fast_bf16")
def test_steps_too_small_for_bfloat16_add_up():
    """From 1 to 1.0078 there is no bfloat16: a hundred steps of 1e-4 need float32."""
    network = nn.Linear(1, 1, bias=False)
    nn.init.ones_(network.weight)
    half = HalfCopy(network, CPU)
    optimizer = torch.optim.SGD(network.parameters(), 1e-4)
    for _ in range(100):
        descend(half.used(torch.ones(1, 1, dtype=torch.bfloat16)).sum(), optimizer, half)
    assert network.weight.item() == pytest.approx(0.99, abs=1e-5)
    assert half.used.weight.item() == torch.tensor(0.99).bfloat16().item()


@pytest.mark.usefixtures("fast_bf16")
def test_gradients_are_laid_out_as_their_weights():
    """Also where those of the copy are not: of a convolution with channels last, say."""
    network = nn.Conv2d(4, 8, 3).to(memory_format=torch.channels_last)
    half = HalfCopy(network, CPU)
    wanted = torch.randn(8, 4, 3, 3).bfloat16()
    half.used.weight.grad, half.used.bias.grad = wanted, torch.zeros(8).bfloat16()
    assert wanted.stride() != network.weight.stride()
    half.hand_over_gradients()
    assert network.weight.grad.stride() == network.weight.stride()
    assert torch.equal(network.weight.grad, wanted.float())


@pytest.mark.usefixtures("fast_bf16")
def test_an_agent_computes_with_its_latest_weights():
    """After updates, and after a checkpoint was loaded."""
    agent, resumed = (CurlSac(2, SMALL, seed=seed) for seed in (0, 1))
    for _ in range(2):
        agent.learn(pixel_batch(SMALL.image_size))
    resumed.load(agent.tensors(), agent.state())
    for one in (agent, resumed):
        for half in (one._half_critic, one._half_target, one._half_actor):
            pairs = half.counterparts()
            assert pairs
            assert all(torch.equal(used, weight.bfloat16()) for weight, used in pairs.items())
    frames = pixel_batch(SMALL.image_size).frames.numpy()
    np.testing.assert_array_equal(agent.act(frames), resumed.act(frames))
