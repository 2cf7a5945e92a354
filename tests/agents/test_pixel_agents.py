"""What holds for every agent that learns from pixels, in a world where the best is known.

A picture shows a brightness, and the reward of an action is −(action − goal)², where the goal
goes from −1 in the dark to 1 in the light.
"""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from batches import learn_now

from simtune.agents import AGENTS, AgentSpec, Observation
from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.agents.pixel_agent import PixelAgent
from simtune.parameters import Parameter, ParameterSpace
from simtune.replay_buffer import Episodes, ReplayBuffer, Transitions
from simtune.run import checkpoint

SIZE, STACKED = 18, 2
SMALL = {"image_size": SIZE, "num_stacked": STACKED, "hidden_size": 64, "batch_size": 32}
SMALL |= {"random_steps": 0, "learning_rate": 2e-3}
CURL = CurlSacConfig(**SMALL, crop_size=16)
SPACE = ParameterSpace(
    [Parameter(name="mass", field="opt.o", nominal=1.0, low=0.1, high=10.0, unit="kg")]
)


# A small one of each `PixelAgent`: how it is made, and with which settings.
SMALL_AGENTS = {"curl_sac": (CurlSac, CURL)}


@pytest.fixture(params=SMALL_AGENTS)
def make(request):
    """make(seed=…, device=…, **changes of the settings) → an agent of one action."""

    def make_agent(seed: int = 0, device: str = "cpu", **changes):
        kind, settings = SMALL_AGENTS[request.param]
        return kind(1, replace(settings, **changes), seed=seed, device=device)

    return make_agent


def test_every_agent_that_learns_from_pixels_is_tested_here():
    spec = AgentSpec(
        image_size=64,
        num_stacked=STACKED,
        num_keypoints=2,
        num_states=2,
        num_positions=1,
        num_actions=1,
        privileged=np.array([True]),
        total_steps=100,
        steps_before_trial=50,
        steps_between_updates=10,
        seed=0,
        device="cpu",
    )
    on_pixels = {name for name, make in AGENTS.items() if isinstance(make(spec), PixelAgent)}
    assert on_pixels == set(SMALL_AGENTS), "add it to SMALL_AGENTS in tests/agents"


def brightness(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, K, H, W, 3) noisy frames and the (n, 1) goals that they show."""
    rng = np.random.default_rng(seed)
    light = rng.uniform(0.1, 0.9, (n, 1))
    noise = rng.normal(0, 8, (n, STACKED, SIZE, SIZE, 3))
    frames = np.clip(255 * light[..., None, None, None] + noise, 0, 255).astype(np.uint8)
    return frames, 2 * light - 1


def a_replay(n: int = 512, device: str = "cpu") -> ReplayBuffer:
    """n episodes of one step, by random actions."""
    frames, goals = brightness(n, seed=1)
    actions = np.random.default_rng(2).uniform(-1, 1, (n, 1, 1)).astype(np.float32)
    replay = ReplayBuffer(SPACE, filmed_capacity=n, num_stacked=STACKED, device=device)
    replay.add(
        Episodes(
            parameters=np.ones((n, 1)),
            full_states=np.zeros((n, 2, 3)),
            states=np.zeros((n, 2, 2), np.float32),
            actions=actions,
            rewards=-np.square(actions[..., 0] - goals).astype(np.float32),
            lengths=np.ones(n, int),
            terminated=np.ones(n, bool),
            frames=frames,
        )
    )
    return replay


def a_batch(n: int = 8, seed: int = 0) -> Transitions:
    """Steps at random, half of which ended their task."""
    draw = torch.Generator().manual_seed(seed)
    seen = torch.randint(256, (n, STACKED + 1, SIZE, SIZE, 3), generator=draw, dtype=torch.uint8)
    return Transitions(
        states=torch.randn(n, 3, generator=draw),
        actions=2 * torch.rand(n, 1, generator=draw) - 1,
        rewards=torch.rand(n, generator=draw),
        discounts=torch.arange(n).remainder(2).float(),
        next_states=torch.randn(n, 3, generator=draw),
        parameters=torch.rand(n, 2, generator=draw),
        frames=seen[:, :-1],
        next_frames=seen[:, 1:],
    )


def everything(agent) -> dict[str, torch.Tensor]:
    """All that can change in an agent, copied."""
    return {name: tensor.detach().clone() for name, tensor in agent.tensors().items()}


def assert_same(some: dict[str, torch.Tensor], others: dict[str, torch.Tensor]) -> None:
    assert some.keys() == others.keys()
    for name, tensor in some.items():
        assert torch.equal(tensor, others[name]), name


def error(agent) -> float:
    frames, goals = brightness(128, seed=9)
    return float(np.abs(agent.act(frames) - goals).mean())


@pytest.mark.thorough
def test_an_agent_learns_to_act_on_what_it_sees(make):
    agent, replay = make(), a_replay()
    assert error(agent) > 0.3
    losses = learn_now(agent, replay, 250)
    assert error(agent) < 0.2
    assert np.isfinite([*losses.values()]).all()


def test_states_and_parameters_do_not_change_what_is_learnt(make):
    batch = a_batch()
    others = {name: getattr(batch, name) + 1e6 for name in ("states", "next_states", "parameters")}
    agents = [make(), make()]
    for _ in range(2):
        agents[0].learn(batch)
        agents[1].learn(replace(batch, **others))
    assert_same(everything(agents[0]), everything(agents[1]))
    frames, _ = brightness(3, seed=0)
    states = (np.zeros((3, 2)), np.full((3, 2), 1e6))
    explored = [
        agent.explore(Observation(state, frames), a_replay(8))
        for agent, state in zip(agents, states, strict=True)
    ]
    np.testing.assert_array_equal(*explored)


@pytest.mark.parametrize("name", ["frames", "next_frames", "actions", "rewards", "discounts"])
def test_everything_else_of_a_transition_changes_what_is_learnt(make, name):
    batch, agents = a_batch(), [make(), make()]
    agents[0].learn(batch)
    agents[1].learn(replace(batch, **{name: 1 - getattr(batch, name)}))
    first, second = (everything(agent) for agent in agents)
    assert any(not torch.equal(first[key], second[key]) for key in first if "critic." in key)


def test_a_resumed_agent_repeats_a_straight_one_bit_for_bit(make, tmp_path):
    replay, (frames, _) = a_replay(), brightness(3, seed=0)
    whole = make(seed=4)
    seen = Observation(np.zeros((3, 0)), frames)
    whole.explore(seen, replay)
    whole.update(replay, 9)
    whole.explore(seen, replay)
    whole.update(replay, 5)
    whole.explore(seen, replay)
    whole.update(replay, 3)
    state = whole.state()
    path = checkpoint.save(tmp_path / "checkpoints", whole.tensors(), state)

    def go_on(agent) -> dict[str, float]:
        agent.explore(seen, replay)
        return agent.update(replay, 5)

    losses = go_on(whole)
    resumed = make(seed=5)
    resumed.load(*checkpoint.load(path))
    assert resumed.state() == state
    assert go_on(resumed) == pytest.approx(losses, rel=0, abs=0, nan_ok=True)
    assert_same(everything(resumed), everything(whole))
    assert resumed.state() == whole.state()
    explored = [agent.explore(seen, replay) for agent in (resumed, whole)]
    np.testing.assert_array_equal(*explored)


def test_a_checkpoint_with_a_generator_of_another_device_is_loaded(make):
    agent, other = make(), make(seed=5)
    tensors = agent.tensors() | {"generator": torch.arange(16, dtype=torch.uint8)}  # a GPU's
    for resumed in (agent, other):
        resumed.load(tensors, agent.state())
    drawn = [a.tensors()["generator"] for a in (agent, other)]
    assert torch.equal(*drawn), "from the same numbers, at least"


def test_a_checkpoint_holds_all_that_changes(make):
    agent = make()
    before = everything(agent)
    learn_now(agent, a_replay(), 4)
    after = everything(agent)
    assert [name for name in before if torch.equal(before[name], after[name])] == []
    moments = [name for name in after if "optimizer" in name]
    assert {name.rpartition(".")[2] for name in moments} == {"exp_avg", "exp_avg_sq", "step"}


def test_the_same_seed_is_the_same_agent(make):
    assert_same(everything(make(seed=3)), everything(make(seed=3)))
    some, others = (make(seed=seed).tensors()["generator"] for seed in (3, 4))
    assert not torch.equal(some, others)


def test_torchs_own_random_numbers_are_left_alone(make):
    before = torch.get_rng_state()
    agent = make()
    replay = a_replay(64)
    agent.update(replay, 2)
    agent.explore(Observation(np.zeros((3, 0)), brightness(3, seed=0)[0]), replay)
    assert torch.equal(torch.get_rng_state(), before)


def test_actions_are_within_bounds_and_drawn_on_request(make):
    agent, (frames, _) = make(), brightness(50, seed=0)
    best, again = agent.act(frames), agent.act(frames)
    np.testing.assert_array_equal(best, again)
    assert best.shape == (50, 1)
    assert best.dtype == np.float32
    drawn, others = agent.act(frames, sample=True), agent.act(frames, sample=True)
    assert not np.array_equal(drawn, best)
    assert not np.array_equal(drawn, others)
    for actions in (best, drawn):
        assert np.abs(actions).max() <= 1


def test_random_steps_come_first_and_teach_nothing(make):
    agent, replay, (frames, _) = make(random_steps=100), a_replay(64), brightness(40, seed=0)
    seen = Observation(np.zeros((40, 0)), frames)
    before = everything(agent)
    # 0, 40 and 80 before them
    random = np.concatenate([agent.explore(seen, replay) for _ in range(3)])
    assert np.abs(random.mean()) < 0.2
    assert random.std() == pytest.approx(3**-0.5, abs=0.08)  # of uniform numbers in [−1, 1]
    losses = agent.update(replay, 100)
    assert all(np.isnan(loss) for loss in losses.values())
    after = everything(agent)
    assert_same(*({k: v for k, v in e.items() if k != "generator"} for e in (before, after)))
    agent.act = lambda frames, sample: np.full((len(frames), 1), 7.0)  # from now on the policy
    agent.update(replay, 3)
    assert (agent.explore(seen, replay) == 7).all()
    assert agent.update(replay, 0).keys() == losses.keys()
    assert agent.state()["num_updates"] == 3


def test_updates_are_counted_over_calls(make):
    agent = make(update_every=3, random_steps=4, batch_size=2)
    done = []
    for num_steps in (2, 4, 1, 0, 5):  # 2, 6, 7, 7 and 12 steps
        learn_now(agent, a_replay(8), num_steps)
        done.append(agent.state()["num_updates"])
    assert done == [0, 0, 1, 1, 2]


def test_an_episodes_updates_are_spread_over_the_steps_of_the_next(make):
    """As many with each step as become due for one, in all worlds together; none are left."""
    agent, replay = make(batch_size=2, update_every=2), a_replay(8)
    seen, done = Observation(np.zeros((3, 0)), brightness(3, seed=0)[0]), []
    agent.update(replay, 9)  # three steps in three worlds
    assert not agent.can_act
    for _ in range(3):
        agent.explore(seen, replay)
        done.append(agent.state()["num_updates"])
    assert done == [2, 4, 4]
    assert agent.can_act
    agent.update(replay, 9)
    assert agent.state()["num_updates"] == 4
    agent.update(replay, 0)  # what was not done while exploring
    assert agent.state()["num_updates"] == 9


def test_updates_wait_for_a_replay_without_filmed_steps(make):
    agent, replay = make(), ReplayBuffer(SPACE, filmed_capacity=8)
    learn_now(agent, a_replay(8), 3)
    agent.update(replay, 3)
    agent.explore(Observation(np.zeros((3, 0)), brightness(3, seed=0)[0]), replay)
    assert agent.state()["num_updates"] == 3
    assert agent.state()["num_due"] == 3
    agent.update(a_replay(8), 0)
    assert agent.state()["num_updates"] == 6


def test_updates_see_what_was_stored_after_they_began(make):
    agent, replay = make(), a_replay(8)
    learn_now(agent, replay, 6)
    before, draws = everything(agent), []
    sample = replay.sample
    replay.sample = lambda *which, **how: draws.append(sample(*which, **how)) or draws[-1]
    replay.rewards[:] = -50.0
    learn_now(agent, replay)
    assert (draws[0].rewards == -50).all()
    assert any(not torch.equal(before[key], value) for key, value in everything(agent).items())


def test_updates_in_bfloat16_go_the_way_of_those_in_float32(make, monkeypatch):
    """On most CPUs it is slow, but it tells whether casts lose gradients."""
    batch, plain = a_batch(64), make()
    for _ in range(2):
        plain.learn(batch)
    monkeypatch.setattr("simtune.networks.layers.has_fast_bf16", lambda device: True)
    cast = make()
    first = {name: tensor for name, tensor in everything(cast).items() if "optimizer" not in name}
    for _ in range(2):
        cast.learn(batch)
    wanted, got = everything(plain), everything(cast)
    del first["generator"]
    for name, before in first.items():
        assert got[name].dtype == before.dtype
        moves = (wanted[name] - before).flatten(), (got[name] - before).flatten()
        if moves[0].norm() > 0:
            assert torch.cosine_similarity(*moves, dim=0) > 0.5, name


def test_batches_made_here_have_the_types_and_shapes_of_a_replays():
    """The transitions that are made up here are of the same types and shapes as a replay's."""
    drawn = a_replay(8).sample(8, torch.Generator(), with_frames=True)
    for field in fields(Transitions):
        made, real = (getattr(batch, field.name) for batch in (a_batch(8), drawn))
        assert made.dtype == real.dtype
        assert made.ndim == real.ndim


@pytest.mark.gpu
def test_an_agent_learns_on_a_gpu(make, tmp_path):
    agent, replay = make(device="cuda"), a_replay(device="cuda")
    learn_now(agent, replay, 200)
    path = checkpoint.save(tmp_path / "checkpoints", agent.tensors(), agent.state())
    resumed = make(device="cuda")
    resumed.load(*checkpoint.load(path))  # after graphs were captured
    losses = learn_now(resumed, replay, 200)
    assert error(resumed) < 0.2
    assert np.isfinite([*losses.values()]).all()
