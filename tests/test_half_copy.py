"""Weights in bfloat16 beside those in float32 that learn."""

import pytest
import torch
from torch import nn

from simtune.agents.half_copy import HalfCopy
from simtune.agents.pixel_networks import TwinQ, descend
from simtune.networks import autocast

CPU = torch.device("cpu")


@pytest.fixture
def fast_bf16(monkeypatch):
    for module in ("simtune.networks", "simtune.agents.half_copy"):
        monkeypatch.setattr(f"{module}.has_fast_bf16", lambda device: True)


def twin() -> TwinQ:
    torch.manual_seed(0)
    return TwinQ(3, 2, 16)


def test_where_bfloat16_is_not_faster_the_network_is_used_itself(monkeypatch):
    monkeypatch.setattr("simtune.agents.half_copy.has_fast_bf16", lambda device: False)
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
