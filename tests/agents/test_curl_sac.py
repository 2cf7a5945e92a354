"""The paper's agent: its losses by hand, and which weight moves by what."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from batches import Same, learn_now, pixel_batch

from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.agents.pixel_networks import (
    Contrast,
    GaussianActor,
    TwinQ,
    initialize,
    move_towards,
    sample_squashed,
)
from simtune.networks.cuda_graph import GraphedStep
from simtune.networks.pixel_encoder import PixelConvolutions, PixelEncoder

SMALL = CurlSacConfig(
    image_size=18, crop_size=16, num_stacked=2, hidden_size=32, batch_size=4, random_steps=0
)


@pytest.fixture(autouse=True)
def float32(monkeypatch):
    """On any CPU: networks are used themselves, and patched."""
    monkeypatch.setattr(
        "simtune.networks.layers.has_fast_bf16", lambda device: device.type == "cuda"
    )


@pytest.fixture
def agent() -> CurlSac:
    return CurlSac(2, SMALL, seed=0)


def weights(module: torch.nn.Module) -> list[torch.Tensor]:
    return [p.detach().clone() for p in module.parameters()]


def same(some: list[torch.Tensor], others: list[torch.Tensor]) -> bool:
    return all(torch.equal(a, b) for a, b in zip(some, others, strict=True))


def as_frames(n: int) -> torch.Tensor:
    return torch.zeros(n, 2, 16, 16, 3, dtype=torch.uint8)


def test_default_networks_have_the_papers_shapes():
    config = CurlSacConfig()
    assert (config.image_size, config.crop_size, config.num_stacked) == (100, 84, 3)
    agent = CurlSac(6, config, seed=0)
    of_critic = [tuple(p.shape) for p in agent.critic.parameters() if p.ndim > 1]
    convolutions = [(32, 9, 3, 3), *[(32, 32, 3, 3)] * 3]
    q = [(1024, 56), (1024, 1024), (1, 1024)]
    assert of_critic == [*convolutions, (50, 32 * 35 * 35), *q, *q]
    of_actor = [tuple(p.shape) for p in agent.actor.parameters() if p.ndim > 1]
    assert of_actor == [(50, 32 * 35 * 35), (1024, 50), (1024, 1024), (12, 1024)]
    assert agent.temperature().item() == pytest.approx(0.1)


def test_a_crop_larger_than_the_picture_is_refused():
    with pytest.raises(ValueError, match="no crop of 84 fits into 64 pixels"):
        CurlSacConfig(image_size=64)


def test_target_q_equals_hand_calculation(agent, monkeypatch):
    """γ = .99, α = .1; the second step ended the task, the third was cut off by time."""
    log_prob = torch.tensor([-2.0, 0.5, 3.0])
    monkeypatch.setattr(agent, "draw", lambda maps: (torch.zeros(3, 2), log_prob))
    values = torch.tensor([[3.0, 5.0, -1.0], [4.0, 1.0, -2.0]])
    monkeypatch.setattr(agent.target.q, "forward", lambda features, actions: values)
    target_q = agent.target_q(
        torch.tensor([1.0, 2.0, 0.5]),
        torch.tensor([1.0, 0.0, 1.0]),
        torch.zeros(3, agent.critic.encoder.convolutions.num_outputs),
    )
    wanted = [1 + 0.99 * (3 + 0.2), 2, 0.5 + 0.99 * (-2 - 0.3)]
    np.testing.assert_allclose(target_q.detach(), wanted, rtol=1e-6)


def test_the_critics_loss_is_the_sum_of_both_mean_squares(agent, monkeypatch):
    target_q, values = torch.tensor([1.0, 2.0]), torch.tensor([[1.0, 4.0], [0.0, 0.0]])
    monkeypatch.setattr(agent, "target_q", lambda *_: target_q)
    first = agent.critic.q.forward
    monkeypatch.setattr(agent.critic.q, "forward", lambda *a: values + 0 * first(*a))
    losses = agent.learn(pixel_batch(SMALL.image_size, 2))
    assert float(losses[0]) == pytest.approx((0 + 4) / 2 + (1 + 4) / 2)
    assert float(losses[2]) == pytest.approx(5 / 4)


@pytest.mark.parametrize(("log_prob", "sign"), [(5.0, 1), (-5.0, -1)])
def test_the_temperature_rises_where_entropy_is_too_low(agent, monkeypatch, log_prob, sign):
    """The entropy wanted is −2, for two actions; Adam's first step is the learning rate."""
    draw = agent.draw
    monkeypatch.setattr(agent, "draw", lambda c: (draw(c)[0], 0 * draw(c)[1] + log_prob))
    before = agent.temperature.log.item()
    _, entropy, temperature = agent.learn_policy(
        torch.rand(3, agent.critic.encoder.convolutions.num_outputs), torch.rand(3, 50)
    )
    assert agent.temperature.log.item() == pytest.approx(before + sign * 1e-4, abs=1e-6)
    assert float(entropy) == -log_prob
    assert temperature.item() == pytest.approx(0.1)


def test_contrastive_loss_equals_a_plain_loop(monkeypatch):
    monkeypatch.setattr("simtune.agents.pixel_networks.NUM_FEATURES", 5)
    torch.manual_seed(0)
    contrast, queries, keys = Contrast(), torch.randn(4, 5), torch.randn(4, 5)
    loss = 0.0
    for i in range(4):
        logits = [(queries[i] @ contrast.weight @ keys[j]).item() for j in range(4)]
        np.testing.assert_allclose(contrast(queries, keys)[i].detach(), logits, rtol=1e-4)
        loss -= math.log(math.exp(logits[i]) / sum(map(math.exp, logits))) / 4
    assert contrast.loss(queries, keys).item() == pytest.approx(loss, rel=1e-4)


def test_targets_are_moving_averages():
    slow, fast = torch.nn.Linear(2, 1), torch.nn.Linear(2, 1)
    wanted = [0.95 * s + 0.05 * f for s, f in zip(weights(slow), weights(fast), strict=True)]
    move_towards(slow, fast, 0.05)
    for got, value in zip(weights(slow), wanted, strict=True):
        torch.testing.assert_close(got, value)


def test_the_encoders_target_moves_faster_than_the_critics(agent):
    before = weights(agent.target.encoder), weights(agent.target.q)
    agent.learn(pixel_batch(SMALL.image_size))
    parts = (
        (before[0], agent.target.encoder, agent.critic.encoder, 0.05),
        (before[1], agent.target.q, agent.critic.q, 0.01),
    )
    for old, target, online, share in parts:
        for was, now, other in zip(old, weights(target), weights(online), strict=True):
            torch.testing.assert_close(now, (1 - share) * was + share * other)


def test_actor_temperature_and_targets_are_updated_every_second_time(agent):
    slow = (agent.actor, agent.temperature, agent.target)
    fast = (agent.critic.encoder, agent.critic.q, agent.contrast)
    replay = Same(pixel_batch(SMALL.image_size))
    for update in range(4):
        before = [weights(module) for module in (*slow, *fast)]
        losses = np.array([*learn_now(agent, replay).values()])
        moved = [
            not same(old, weights(module))
            for old, module in zip(before, (*slow, *fast), strict=True)
        ]
        assert moved == [update % 2 == 0] * 3 + [True] * 3
        assert np.isnan(losses).tolist() == [False] * 3 + [update % 2 == 1] * 3


def test_the_actors_gradient_reaches_the_actor_alone(agent):
    others = (agent.critic, agent.target, agent.contrast)
    for module in others:
        module.zero_grad(set_to_none=True)
    before = [weights(module) for module in others]
    seen = agent.target.encoder.convolutions(as_frames(3))
    assert not seen.requires_grad
    of_actor = weights(agent.actor)
    agent.learn_policy(seen, torch.rand(3, 50))
    assert not same(of_actor, weights(agent.actor))
    for module, old in zip(others, before, strict=True):
        assert same(old, weights(module))
        assert all(p.grad is None for p in module.parameters())


def test_critics_and_contrast_both_teach_the_encoder(monkeypatch):
    def gradient_without(method: str | None) -> torch.Tensor:
        other = CurlSac(2, SMALL, seed=0)
        with monkeypatch.context() as patch:
            if method == "contrast":
                patch.setattr(other.contrast, "loss", lambda q, k: (0 * q).sum())
            if method == "critic":
                patch.setattr(other.critic.q, "forward", lambda f, a: 0 * f.sum(1).expand(2, -1))
            other.learn(pixel_batch(SMALL.image_size))
        return other.critic.encoder.convolutions.layers[0].weight.grad

    both, critic, contrast = (gradient_without(m) for m in (None, "contrast", "critic"))
    assert critic.norm() > 0
    assert contrast.norm() > 0
    torch.testing.assert_close(both, critic + contrast, rtol=1e-3, atol=1e-5)


def test_log_prob_is_that_of_a_transformed_distribution():
    draw = torch.Generator().manual_seed(1)
    mean = torch.tensor([[0.3, -2.0], [1.5, 0.0]], dtype=torch.float64)
    log_std = torch.tensor([[-1.0, 0.5], [0.0, -3.0]], dtype=torch.float64)
    actions, log_prob = sample_squashed(mean, log_std, draw)
    normal = torch.distributions.Normal(mean, log_std.exp())
    squashed = torch.distributions.TransformedDistribution(
        normal, [torch.distributions.TanhTransform()]
    )
    torch.testing.assert_close(log_prob, squashed.log_prob(actions).sum(-1))


def test_log_std_stays_within_its_bounds():
    actor = GaussianActor(6, 1, 4, (-10.0, 2.0))
    for huge, bound in ((1e6, 2.0), (-1e6, -10.0), (0.0, -4.0)):
        torch.nn.init.zeros_(actor.layers[-1].weight)
        torch.nn.init.constant_(actor.layers[-1].bias, huge)
        assert actor(torch.ones(1, 6))[1].item() == bound


def test_two_qs_are_two_networks():
    twin = TwinQ(3, 2, 8)
    features, actions = torch.randn(5, 3), torch.randn(5, 2)
    both = twin(features, actions)
    assert both.shape == (2, 5)
    for values, network in zip(both, twin.networks, strict=True):
        hidden = torch.cat([features, actions], 1)
        for layer in network:
            hidden = layer(hidden)
        torch.testing.assert_close(values, hidden[:, 0])
    assert not torch.equal(both[0], both[1])


def test_values_are_not_rounded_where_bfloat16_is_used_for_speed():
    """From 256 to 512 bfloat16 knows every other number: the last layer is none of it."""
    torch.manual_seed(0)
    twin = TwinQ(3, 2, 8)
    for network in twin.networks:
        torch.nn.init.constant_(network[-1].bias, 300.4)
    features, actions = torch.randn(5, 3), torch.randn(5, 2)
    with torch.autocast("cpu", torch.bfloat16):
        values = twin(features, actions)
    assert values.dtype == torch.float32
    torch.testing.assert_close(values, twin(features, actions), rtol=0, atol=0.02)


def test_initial_weights_are_orthogonal():
    module = torch.nn.Sequential(torch.nn.Conv2d(3, 8, 3), torch.nn.Linear(9, 4))
    initialize(module)
    convolution, linear = (part.weight.detach() for part in module)
    torch.testing.assert_close(linear @ linear.T, torch.eye(4))
    centre = convolution[:, :, 1, 1]
    torch.testing.assert_close(centre.T @ centre, 2 * torch.eye(3))  # ReLU's gain, squared
    assert convolution.count_nonzero() == centre.count_nonzero()
    assert all(part.bias.count_nonzero() == 0 for part in module)


@pytest.mark.parametrize("on_gpu", [False, True])
@pytest.mark.parametrize("num_stacked", [1, 3, 8, 10])
def test_convolutions_equal_torchs_own_layers(num_stacked, on_gpu):
    torch.manual_seed(0)
    frames = torch.randint(256, (18, num_stacked, 17, 17, 3), dtype=torch.uint8)
    convolutions = PixelConvolutions(3 * num_stacked, 17)
    wanted = frames.permute(0, 1, 4, 2, 3).flatten(1, 2) / 255
    for layer in convolutions.layers:
        wanted = layer(wanted)
    wanted = wanted.permute(0, 2, 3, 1).flatten(1)
    if on_gpu:
        convolved = convolutions._in_few_kernels(frames).permute(0, 2, 3, 1).flatten(1)
    else:
        convolved = convolutions(frames)
    gradients = [
        torch.autograd.grad(maps.square().sum(), [*convolutions.parameters()])
        for maps in (wanted, convolved)
    ]
    torch.testing.assert_close(convolved, wanted)
    torch.testing.assert_close(gradients[1], gradients[0], rtol=1e-4, atol=1e-5)


def test_the_encoder_is_its_convolutions_and_its_head():
    encoder = PixelEncoder(6, 16)
    frames = as_frames(3) + torch.arange(3, dtype=torch.uint8)[:, None, None, None, None]
    torch.testing.assert_close(encoder(frames), encoder.head(encoder.convolutions(frames)))


def test_the_agent_acts_on_the_centre_of_its_pictures(agent):
    frames = torch.randint(256, (3, 2, 18, 18, 3), dtype=torch.uint8).numpy()
    others = frames.copy()
    others[:, :, [0, -1]] = 255 - others[:, :, [0, -1]]
    others[:, :, :, [0, -1]] = 255 - others[:, :, :, [0, -1]]
    np.testing.assert_array_equal(agent.act(frames), agent.act(others))
    others[:, :, 8:11, 8:11] = 255 - others[:, :, 8:11, 8:11]
    assert not np.array_equal(agent.act(frames), agent.act(others))


def test_the_benchmarks_baseline_computes_what_the_agent_does(agent, monkeypatch):
    """With the same weights it says the same of the same pictures."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    from baselines.eager_curl_sac import EagerCurlSac

    eager, batch = EagerCurlSac(2, SMALL, "cpu"), pixel_batch(SMALL.image_size)
    side = 1  # of what is left of 16 pixels
    encoder, copied = agent.critic.encoder, eager.critic.encoder
    convolutions = [layer for layer in encoder.convolutions.layers if hasattr(layer, "weight")]
    for ours, theirs in zip(convolutions, copied.convs, strict=True):
        theirs.load_state_dict(ours.state_dict())
    for head, into in ((encoder.head, copied), (agent.actor.head, eager.actor.encoder)):
        by_place = head[0].weight.detach().unflatten(1, (side, side, 32)).permute(0, 3, 1, 2)
        into.fc.load_state_dict({"weight": by_place.flatten(1), "bias": head[0].bias.detach()})
    for ours, theirs in zip(
        agent.critic.q.networks, (eager.critic.q1, eager.critic.q2), strict=True
    ):
        theirs.load_state_dict(ours.state_dict())
    eager.actor.trunk.load_state_dict(agent.actor.layers.state_dict())

    frames = batch.frames[:, :, 1:17, 1:17]
    stacked = frames.permute(0, 1, 4, 2, 3).flatten(1, 2).float()
    q = agent.critic.q(encoder(frames), batch.actions)
    torch.testing.assert_close(torch.cat(eager.critic(stacked, batch.actions), 1).T, q)
    monkeypatch.setattr(torch, "randn_like", torch.zeros_like)
    mean, log_std = agent.actor(encoder.convolutions(frames))
    action, log_prob = eager.actor(stacked)
    torch.testing.assert_close(action, mean.tanh())
    normal = torch.distributions.Normal(mean, log_std.exp())
    wanted = (normal.log_prob(mean) - torch.log(1 - mean.tanh().square())).sum(1, keepdim=True)
    torch.testing.assert_close(log_prob, wanted, rtol=1e-4, atol=1e-4)


@pytest.mark.gpu
def test_a_cuda_graph_repeats_the_step_it_was_captured_from():
    draw = torch.Generator("cuda").manual_seed(0)
    total = torch.zeros(3, device="cuda")

    def step(x: torch.Tensor) -> torch.Tensor:
        noise = torch.rand(3, generator=draw, device="cuda")
        total.add_(x)
        return torch.stack([2 * x, noise])

    graphed = GraphedStep(step, draw)
    inputs = [torch.full((3,), float(i), device="cuda") for i in range(8)]
    outputs = [graphed(x).clone() for x in inputs]
    for x, output in zip(inputs, outputs, strict=True):
        torch.testing.assert_close(output[0], 2 * x)
    torch.testing.assert_close(total, sum(inputs))  # the capture itself ran nothing
    noises = torch.stack([output[1] for output in outputs])
    assert len(noises.unique()) == noises.numel()


@pytest.mark.gpu
def test_updates_by_cuda_graphs_equal_plain_updates():
    config = CurlSacConfig(**vars(SMALL) | {"crop_size": 18, "log_std": (-10.0, -9.99)})
    graphed, plain = (
        CurlSac(2, config, seed=0, device="cuda", use_graphs=use) for use in (True, False)
    )
    replay = Same(pixel_batch(SMALL.image_size)).on("cuda")
    for _ in range(12):  # six of each kind, three of which warm up
        losses = [[*learn_now(agent, replay).values()] for agent in (graphed, plain)]
    np.testing.assert_allclose(*losses, rtol=0.05, atol=0.01)
