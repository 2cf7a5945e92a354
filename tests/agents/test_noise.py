"""Noise on actions, by which the teacher explores."""

import pytest
import torch

from simtune.agents.noise import disturbed


def test_noise_has_the_std_asked_for_and_gradients_pass_where_it_is_clipped():
    actions = torch.full((4000, 2), 0.2, requires_grad=True)
    noisy = disturbed(actions.detach(), 0.1, torch.Generator().manual_seed(0))
    assert float(noisy.std()) == pytest.approx(0.1, rel=0.05)
    assert float(noisy.mean()) == pytest.approx(0.2, abs=0.01)
    clipped = disturbed(actions.detach(), 5.0, torch.Generator().manual_seed(0), clip=0.5)
    assert float(clipped.min()) == pytest.approx(-0.3)
    assert float(clipped.max()) == pytest.approx(0.7)
    wide = disturbed(actions, 5.0, torch.Generator().manual_seed(0))
    assert wide.abs().max() == 1
    wide.sum().backward()
    assert (actions.grad == 1).all()
