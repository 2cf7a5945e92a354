"""search="paper" and its baseline: the rules by hand, the network against plain loops."""

import json
import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from simtune.errors import InputError
from simtune.networks import PixelEncoder, positional_encoding, predicting
from simtune.parameters import Parameter, ParameterSpace
from simtune.search_param_model.paper import PaperConfig, PaperSearchParamModel, count_votes
from simtune.search_param_model.windows import Windows, split
from simtune.simulation import Rollouts, Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.paper import PaperSearch, approach, shift_mean

SIZE = 20
SMALL = PaperConfig(
    window=3,
    crop_size=16,
    hidden_size=48,
    dropout=0.2,
    batch_size=8,
    num_candidates=24,
    episodes_per_iteration=5,
    updates_per_episode=6,
    episode_steps=12,
    collect_steps=120,
    pretrain_steps=180,
    buffer_episodes=20,
    step_size=0.5,
)
UNSURE = (0.3, 0.7)


def a_parameter(name: str, low: float, high: float, scale: str = "linear") -> Parameter:
    nominal = (low + high) / 2
    return Parameter(
        name=name, field="opt.o", nominal=nominal, low=low, high=high, scale=scale, unit="1"
    )


SPACE = ParameterSpace([a_parameter("left", 0.0, 1.0), a_parameter("right", 0.05, 5.0, "log")])


class FakeSimulator:
    """Worlds whose picture shows one parameter in its left half and one in its right."""

    can_start_anywhere = True

    def __init__(self):
        self.space = SPACE
        self.image_size = SIZE
        self.num_steps = 0
        self.action_mapping = SimpleNamespace(range=np.array([[-4.0, 2.0], [-1.0, 1.0]]))

    action_scale = Simulator.action_scale

    def roll_out(self, parameters, actions, rng) -> Rollouts:
        n, num_steps, _ = actions.shape
        self.num_steps += n * num_steps
        states, lengths = rng.normal(size=(n, num_steps + 1, 1)), np.full(n, num_steps)
        observed = np.empty((n, num_steps + 1, 0))
        return Rollouts(parameters, states, actions, lengths, observed, np.arange(n))

    def render(self, states, parameters) -> np.ndarray:
        left, right = SPACE.to_unit(parameters).T
        frames = np.empty((len(states), SIZE, SIZE, 3))
        frames[:, :, : SIZE // 2] = left[:, None, None, None]
        frames[:, :, SIZE // 2 :] = right[:, None, None, None]
        noise = 0.02 * np.sin(states)[..., None, None]
        return (np.clip(frames + noise, 0, 1) * 255).astype(np.uint8)

    film = Simulator.film


def real_of(parameters: np.ndarray, num: int = 2) -> list[Trajectory]:
    rng = np.random.default_rng(7)
    simulator = FakeSimulator()
    actions = rng.uniform(-1, 1, (num, 14, 2)).astype(np.float32)
    rollouts = simulator.roll_out(np.tile(parameters, (num, 1)), actions, rng)
    frames = simulator.film(rollouts)
    return [Trajectory(f, a, 0.1) for f, a in zip(frames, actions, strict=True)]


def some_windows(num: int, config: PaperConfig = SMALL) -> Windows:
    rng = np.random.default_rng(0)
    frames = rng.integers(256, size=(num, config.window, config.crop_size, config.crop_size, 3))
    actions = rng.uniform(-1, 1, (num, config.window, 2))
    return Windows(
        torch.as_tensor(frames, dtype=torch.uint8), torch.as_tensor(actions, dtype=torch.float32)
    )


def a_model(method="paper", config: PaperConfig = SMALL) -> PaperSearchParamModel:
    torch.manual_seed(0)
    return PaperSearchParamModel(config, SPACE, np.array([4.0, 1.0]), method)


def test_shift_mean_by_hand():
    space = ParameterSpace([a_parameter(n, 0.0, 1.0) for n in "abcde"])
    mean = np.array([0.5, 0.5, 0.5, 0.99, 1e-3])
    prob_higher = np.array([1.0, 0.0, 0.5, 1.0, 0.0])
    shifted = shift_mean(mean, prob_higher, 0.1, space)
    # 5 % up, 5 % down, as it was, clipped to the bound, kept at the floor
    np.testing.assert_allclose(shifted, [0.525, 0.475, 0.5, 1.0, 1e-3], rtol=1e-12)
    np.testing.assert_allclose(shift_mean(mean[:1], np.array([0.75]), 0.1, SPACE), 0.5125)


def test_approach_by_hand():
    moved = approach(np.array([0.5, 1.0]), np.array([1.0, 0.5]), 0.1, SPACE)
    np.testing.assert_allclose(moved, [0.55, 0.95])


def test_votes_by_hand():
    windows = np.array([[0.9, 0.31, 0.29], [0.71, 0.69, 0.1], [0.5, 0.5, 0.7], [0.2, 0.6, 0.3]])
    np.testing.assert_array_equal(count_votes(windows, UNSURE), [2.5 / 4, 2.0 / 4, 1.0 / 4])


def test_votes_are_averaged_over_windows_then_episodes(monkeypatch):
    model = a_model()
    logits = [torch.tensor([[[9.0, 9.0]], [[9.0, -9.0]], [[-9.0, -9.0]], [[0.0, -9.0]]])]
    logits.append(torch.tensor([[[9.0, -9.0]]]))  # an episode of one window counts as much
    monkeypatch.setattr(model, "_over_episodes", lambda *_: iter(logits))
    expected = [(2.5 / 4 + 1) / 2, (1 / 4 + 0) / 2]
    np.testing.assert_array_equal(model.prob_higher([], SPACE.nominal), expected)


def test_label_is_true_where_the_truth_is_higher(monkeypatch):
    model = a_model()
    says_higher_lower = torch.tensor([[[20.0, -20.0]]])
    monkeypatch.setattr(model, "forward", lambda *_: says_higher_lower)
    truth, candidates = np.array([[0.6, 0.6]]), np.array([[0.5, 0.7]])
    assert model.loss(some_windows(1), truth, candidates) < 1e-6
    assert model.loss(some_windows(1), candidates, truth) > 19


def test_positional_encoding_equals_the_plain_loop():
    x = torch.tensor([[0.0, 0.3], [0.81, 1.0]], dtype=torch.float64)
    encoded = positional_encoding(x, octaves=4)
    for row in range(2):
        plain = []
        for value in x[row].tolist():
            plain.append(value)
            plain += [math.sin(2**k * math.pi * value) for k in range(4)]
            plain += [math.cos(2**k * math.pi * value) for k in range(4)]
        np.testing.assert_allclose(encoded[row], plain, atol=1e-12)


def test_encoder_is_the_agents():
    encoder = PixelEncoder(30, 84)
    shapes = [tuple(p.shape) for p in encoder.parameters() if p.ndim > 1]
    convolutions = [(32, 30, 3, 3), *[(32, 32, 3, 3)] * 3]
    assert shapes == [*convolutions, (50, 32 * 35 * 35)]
    features = encoder(torch.randint(256, (2, 10, 84, 84, 3), dtype=torch.uint8))
    np.testing.assert_allclose(features.mean(1).detach(), 0, atol=1e-4)  # LayerNorm comes last


def test_split_gives_all_whole_windows_from_the_centre():
    (trajectory, _) = real_of(np.array([0.5, 0.5]))
    windows = split(trajectory, 4, 16)
    assert windows.frames.shape == (3, 4, 16, 16, 3)
    for i in range(3):
        frames = trajectory.frames[4 * i : 4 * i + 4, 2:18, 2:18]
        np.testing.assert_array_equal(windows.frames[i], frames)
        np.testing.assert_array_equal(windows.actions[i], trajectory.actions[4 * i : 4 * i + 4])
    with pytest.raises(ValueError, match="15 steps of at least 16 × 16 pixels, got 14 steps"):
        split(trajectory, 15, 16)


def test_no_dropout_in_predictions():
    model, real = a_model(), real_of(np.array([0.5, 0.5]))
    windows, candidates = some_windows(2), SPACE.nominal[None]
    assert not torch.equal(model(windows, candidates), model(windows, candidates))  # training
    with predicting(model):
        assert torch.equal(model(windows, candidates), model(windows, candidates))
    assert model.training
    np.testing.assert_array_equal(
        model.prob_higher(real, SPACE.nominal), model.prob_higher(real, SPACE.nominal)
    )


@torch.inference_mode()
def test_candidates_at_once_equal_the_plain_loop(monkeypatch):
    monkeypatch.setattr("simtune.networks.has_fast_bf16", lambda device: False)
    model = a_model().eval()
    windows = some_windows(3)
    candidates = SPACE.from_unit(np.random.default_rng(1).uniform(size=(5, 2)))
    logits = model(windows, candidates)
    assert logits.shape == (3, 5, 2)
    scaled = windows.actions / torch.tensor([4.0, 1.0])
    for b in range(3):
        for c in range(5):
            features = model.encoder(windows.frames[b : b + 1])
            unit = torch.as_tensor(SPACE.to_unit(candidates[c]), dtype=torch.float32)
            encoded = positional_encoding(unit[None], SMALL.octaves)
            plain = model.head(torch.cat([features, scaled[b : b + 1].flatten(1), encoded], 1))
            np.testing.assert_allclose(logits[b, c], plain[0], atol=2e-5)


@pytest.mark.parametrize("method", ["paper", "regression"])
def test_finds_the_truth_of_a_tiny_world(method):
    truth, start = np.array([0.4, 1.0]), np.array([0.8, 0.5])  # ×2 and ×½
    search = PaperSearch(FakeSimulator(), start, SMALL, seed=0, method=method)
    for _ in range(9):
        estimate, _, scalars = search.iterate(real_of(truth), math.inf)
    np.testing.assert_array_less(np.abs(np.log(estimate.mean / truth)), np.log(2) / 2)
    assert np.isfinite(list(scalars.values())).all()
    assert search._simulator.num_steps == 12 * search._store.num_added


def test_pretraining_leaves_the_mean_where_it_is():
    search = PaperSearch(FakeSimulator(), SPACE.nominal, SMALL, seed=0)
    real = real_of(np.array([0.1, 0.1]))
    for moves in (0, 0, 0, 1):  # 180, 240, 300 and 360 steps collected; 300 are pretraining
        estimate, events, scalars = search.iterate(real, math.inf)
        assert search.num_moves == moves
        assert np.array_equal(estimate.mean, SPACE.nominal) == (moves == 0)
        assert set(scalars) == {"spm_loss", "prob_higher/left", "prob_higher/right"}
    assert events == []
    np.testing.assert_allclose(estimate.high, SPACE.clip(2 * estimate.mean))
    assert estimate.verdict == ["weak", "weak"]


def test_arrival_at_a_bound_is_an_event():
    config = PaperConfig(**vars(SMALL) | {"collect_steps": 0, "pretrain_steps": 0})
    search = PaperSearch(FakeSimulator(), np.array([0.95, 1.0]), config, seed=0)
    search.model.prob_higher = lambda *_: np.array([1.0, 0.5])  # type: ignore[method-assign]
    real = real_of(np.array([1.0, 1.0]))
    first, second = (search.iterate(real, math.inf)[1] for _ in range(2))
    assert [(e.event, e.parameter, e.low, e.high) for e in first] == [("moved", "left", 0.0, 1.0)]
    assert second == []


def test_deadline_is_kept():
    search = PaperSearch(FakeSimulator(), SPACE.nominal, SMALL, seed=0)
    started = time.monotonic()
    search.iterate(real_of(SPACE.nominal), started)
    assert search._store.num_added == 10  # one helping of the first collection, and the iteration's
    assert time.monotonic() - started < 2


@pytest.mark.parametrize("method", ["paper", "regression"])
def test_resumes_bit_for_bit(method):
    real = real_of(np.array([0.4, 1.0]))

    def start() -> PaperSearch:
        return PaperSearch(FakeSimulator(), SPACE.nominal, SMALL, seed=3, method=method)

    straight = start()
    for _ in range(3):  # 25 episodes into 20 slots: the oldest are gone
        straight.iterate(real, math.inf)
    tensors = {k: v.clone() for k, v in straight.tensors().items()}
    state = json.loads(json.dumps(straight.state()))
    resumed = start()
    resumed.load(tensors, state)
    torch.rand(5)  # what others draw from torch does not matter
    for _ in range(2):  # the second of them moves the mean
        one, _, one_scalars = straight.iterate(real, math.inf)
        other, _, other_scalars = resumed.iterate(real, math.inf)
        assert one_scalars == other_scalars
        np.testing.assert_array_equal(one.mean, other.mean)
    for name, tensor in straight.tensors().items():
        assert torch.equal(tensor, resumed.tensors()[name]), name


def test_a_fresh_search_can_be_saved():
    search = PaperSearch(FakeSimulator(), SPACE.nominal, SMALL, seed=0)
    other = PaperSearch(FakeSimulator(), SPACE.low + 0.1, SMALL, seed=1)
    other.load(search.tensors(), search.state())
    np.testing.assert_array_equal(other.distribution.mean, SPACE.nominal)


def test_recorded_actions_are_replayed():
    search = PaperSearch(FakeSimulator(), SPACE.nominal, SMALL, seed=0)
    real = real_of(SPACE.nominal)
    search.iterate(real, math.inf)
    allowed = {t.actions[:12].tobytes() for t in real}
    stored = search._store.actions[: len(search._store)] * torch.tensor([4.0, 1.0])
    assert {a.numpy().tobytes() for a in stored} == allowed


def test_unusable_input_is_refused():
    space = ParameterSpace([a_parameter("tilt", -1.0, 1.0)])
    simulator = FakeSimulator()
    simulator.space = space
    with pytest.raises(InputError, match="tilt"):
        PaperSearch(simulator, space.nominal, SMALL, seed=0)  # type: ignore[arg-type]
    search = PaperSearch(FakeSimulator(), SPACE.nominal, SMALL, seed=0)
    (trajectory, _) = real_of(SPACE.nominal)
    short = Trajectory(trajectory.frames[:3], trajectory.actions[:2], 0.1)
    with pytest.raises(InputError, match="at least 3 steps, got one of 2"):
        search.iterate([short], math.inf)
    small = Trajectory(trajectory.frames[:, :16], trajectory.actions, 0.1)
    with pytest.raises(ValueError, match="must be 20 × 20, got 16 × 20"):
        search.iterate([small], math.inf)
