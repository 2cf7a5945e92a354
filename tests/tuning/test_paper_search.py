"""search="paper" and its baseline: the rules by hand, the network against plain loops."""

import json
import math
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from simtune.budget import Budget
from simtune.errors import InputError
from simtune.networks.layers import positional_encoding, predicting
from simtune.networks.pixel_encoder import PixelEncoder
from simtune.observation import JointSensor, ObservationModel
from simtune.parameters import Parameter, ParameterSpace
from simtune.search_param_model.paper import Method, PaperConfig, PaperSearchParamModel, count_votes
from simtune.search_param_model.windows import Windows, split
from simtune.simulation import Points, Rollouts, Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.mean_update import approach, shift_mean
from simtune.tuning.paper import PaperSearch
from simtune.tuning.search import SearchContext

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

ONE = ParameterSpace([a_parameter("left", 0.0, 1.0)])


class FakeSimulator(Simulator):
    """Worlds whose picture shows one parameter in its left half and one in its right."""

    can_start_anywhere = True

    def __init__(self, is_dark: bool = False):
        self.is_dark = is_dark  # whether a sensor alone tells the first parameter
        self.space = SPACE
        self.image_size = SIZE
        self.num_steps = 0
        self.played: list[np.ndarray] = []

    can_start_anywhere = True
    action_mapping = SimpleNamespace(range=np.array([[-4.0, 2.0], [-1.0, 1.0]]))

    def roll_out(self, parameters, actions, rng, observe=None) -> Rollouts:
        n, num_steps, _ = actions.shape
        self.played.extend(actions)
        self.num_steps += n * num_steps
        states, lengths = rng.normal(size=(n, num_steps + 1, 1)), np.full(n, num_steps)
        observed = 20 + np.repeat(SPACE.to_unit(parameters)[:, None, :1], num_steps + 1, 1)
        observed = observed[..., : int(self.is_dark)]
        return Rollouts(parameters, states, actions, lengths, observed, np.arange(n))

    def render(self, states, parameters, stray=None) -> np.ndarray:
        left, right = SPACE.to_unit(parameters).T
        left = 0 * left if self.is_dark else left
        frames = np.empty((len(states), SIZE, SIZE, 3))
        frames[:, :, : SIZE // 2] = left[:, None, None, None]
        frames[:, :, SIZE // 2 :] = right[:, None, None, None]
        noise = 0.02 * np.sin(states)[..., None, None]
        return (np.clip(frames + noise, 0, 1) * 255).astype(np.uint8)


def a_search(
    simulator: FakeSimulator | None = None,
    start: np.ndarray = SPACE.nominal,
    config: PaperConfig = SMALL,
    seed: int = 0,
    method: Method = "paper",
    known: np.ndarray | None = None,
) -> PaperSearch:
    simulator = simulator or FakeSimulator()
    context = SearchContext(
        simulator=simulator,
        keypoints=Points(np.zeros(0, int), SIZE),
        start=start,
        observation=observed_of(simulator),
        seed=seed,
        known=known,
    )
    return PaperSearch(context, config, method=method)


def observed_of(simulator: FakeSimulator) -> ObservationModel:
    encoder = JointSensor(
        name="encoder", columns=("a",), joints=("a",), places=np.zeros(1, int),
        factor=np.ones(1), shift=np.zeros(1), noise=0.01,
    )  # fmt: skip
    return ObservationModel.of_simulator((encoder,) if simulator.is_dark else ())


def real_of(parameters: np.ndarray, num: int = 2, is_dark: bool = False) -> list[Trajectory]:
    rng = np.random.default_rng(7)
    simulator = FakeSimulator(is_dark)
    actions = rng.uniform(-1, 1, (num, 14, 2)).astype(np.float32)
    rollouts = simulator.roll_out(np.tile(parameters, (num, 1)), actions, rng)
    frames, read = simulator.film(rollouts), rollouts.observed
    return [
        Trajectory(f, a, 0.1, readings={"encoder": r} if is_dark else {})
        for f, a, r in zip(frames, actions, read, strict=True)
    ]


def some_windows(num: int, config: PaperConfig = SMALL) -> Windows:
    rng = np.random.default_rng(0)
    frames = rng.integers(256, size=(num, config.window, config.crop_size, config.crop_size, 3))
    actions = rng.uniform(-1, 1, (num, config.window, 2))
    return Windows(
        torch.as_tensor(frames, dtype=torch.uint8),
        torch.as_tensor(actions, dtype=torch.float32),
        torch.empty(num, config.window, 0),
    )


def a_model(method="paper", config: PaperConfig = SMALL) -> PaperSearchParamModel:
    torch.manual_seed(0)
    return PaperSearchParamModel(config, SPACE, np.array([4.0, 1.0]), method)


def test_readings_are_scaled_by_those_that_were_read():
    """A torque is unknown in each episode's first row."""
    config = PaperConfig(window=4, crop_size=32)
    model = PaperSearchParamModel(config, SPACE, np.array([4.0, 1.0]), num_readings=2)
    readings = np.random.default_rng(0).normal([1, 2], [3, 4], (3, 5, 2))
    readings[:, 0, 1] = np.nan
    model.scale_readings(readings)
    known = readings[:, 1:, 1]
    assert model.get_buffer("usual_reading")[1].item() == pytest.approx(known.mean(), rel=1e-5)
    assert model.get_buffer("reading_spread")[1].item() == pytest.approx(known.std(), rel=1e-5)


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
    logits = [[9.0, 9.0], [9.0, -9.0], [-9.0, -9.0], [0.0, -9.0], [9.0, -9.0]]

    def of_window(windows: Windows, candidates) -> torch.Tensor:
        """By the number of a window, which its actions are."""
        return torch.tensor([[logits[int(number)]] for number in windows.actions[:, 0, 0]])

    monkeypatch.setattr(model, "forward", of_window)
    numbers = np.repeat(np.arange(5.0), SMALL.window).astype(np.float32)
    episodes = [
        Trajectory(np.zeros((len(its) + 1, SIZE, SIZE, 3), np.uint8), np.stack([its, its], 1), 0.1)
        for its in np.split(numbers, [4 * SMALL.window])
    ]  # four windows, and one, which counts as much
    expected = [(2.5 / 4 + 1) / 2, (1 / 4 + 0) / 2]
    np.testing.assert_array_equal(model.prob_higher(episodes, SPACE.nominal), expected)


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


def test_encoder_has_the_agents_layers():
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


def test_predictions_have_no_dropout():
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
    monkeypatch.setattr("simtune.networks.layers.has_fast_bf16", lambda device: False)
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


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["paper", "regression"])
def test_paper_search_finds_the_truth_of_a_tiny_world(method):
    truth, start = np.array([0.4, 1.0]), np.array([0.8, 0.5])  # ×2 and ×½
    simulator = FakeSimulator()
    search, errors = a_search(simulator, start, method=method), []
    for _ in range(11):
        estimate, _, scalars = search.run_round(real_of(truth), Budget())
        errors.append(np.abs(np.log(estimate.mean / truth)))
    # Of three rounds, as answers move to and fro about the truth
    np.testing.assert_array_less(np.mean(errors[-3:], 0), np.log(2) / 2)
    assert np.isfinite(list(scalars.values())).all()
    # Episodes of 12 steps, five at a time: twice before the first round, and in each
    assert simulator.num_steps == 12 * 5 * (2 + 11)


@pytest.mark.thorough
def test_what_only_a_sensor_tells_is_found_beside_the_pictures():
    truth, start = np.array([0.4, 1.0]), np.array([0.8, 0.5])
    search, real = a_search(FakeSimulator(is_dark=True), start), real_of(truth, is_dark=True)
    gap = real[0].readings["encoder"].copy()
    gap[3] = np.nan
    real[0] = replace(real[0], readings={"encoder": gap})
    for _ in range(9):
        estimate, _, _ = search.run_round(real, Budget())
    np.testing.assert_array_less(np.abs(np.log(estimate.mean / truth)), np.log(2) / 2)
    # What it was scaled by goes along, as nothing else says it
    again = a_search(FakeSimulator(is_dark=True), start)
    again.load(search.tensors(), search.state())
    assert again.model.get_buffer("usual_reading").item() == pytest.approx(20.7, abs=0.3)
    candidate = np.array([0.6, 1.0])
    np.testing.assert_array_equal(
        again.model.prob_higher(real, candidate), search.model.prob_higher(real, candidate)
    )


def test_pretraining_leaves_the_mean_where_it_is():
    search, real = a_search(), real_of(np.array([0.1, 0.1]))
    for moves in (0, 0, 0, 1):  # 180, 240, 300 and 360 steps collected; 300 are pretraining
        estimate, events, scalars = search.run_round(real, Budget())
        assert (estimate.verdict == ["not identifiable"] * 2) == (moves == 0)
        assert ["has not moved yet" in words for words in estimate.warnings] == [True] * (not moves)
        assert search.num_moves == moves
        assert np.array_equal(estimate.mean, SPACE.nominal) == (moves == 0)
        assert set(scalars) == {"spm_loss", "prob_higher/left", "prob_higher/right"}
    assert events == []
    np.testing.assert_allclose(estimate.high, SPACE.clip(2 * estimate.mean))
    assert estimate.verdict == ["weak", "weak"]


def test_arrival_of_a_mean_at_a_bound_is_an_event():
    config = PaperConfig(**vars(SMALL) | {"collect_steps": 0, "pretrain_steps": 0})
    search = a_search(start=np.array([0.95, 1.0]), config=config)
    search.model.prob_higher = lambda *_: np.array([1.0, 0.5])  # type: ignore[method-assign]
    real = real_of(np.array([1.0, 1.0]))
    first, second = (search.run_round(real, Budget())[1] for _ in range(2))
    assert [(e.event, e.parameter, e.low, e.high) for e in first] == [("moved", "left", 0.0, 1.0)]
    assert second == []


def test_a_mean_that_starts_at_zero_keeps_a_range_and_gets_to_its_upper_bound():
    search = a_search(start=np.array([0.0, 1.0]), config=replace(SMALL, step_size=0.1))
    search.model.prob_higher = lambda *_: np.array([1.0, 0.5])  # type: ignore[method-assign]
    means, tops = [], []
    for _ in range(100):
        means.append(search.distribution.mean[0])
        tops.append(search.distribution.high[0])
        search._move([], may_move=True)
    # Half of α of a tenth of the bounds, until the mean is larger: then, of the mean
    np.testing.assert_allclose(means[:3], [0.0, 0.005, 0.01])
    np.testing.assert_allclose(tops[:3], [0.1, 0.105, 0.11])
    assert means[-1] == 1.0
    # What starts above 0 moves in proportion, however small it is
    low = shift_mean(np.array([0.01]), np.ones(1), 0.1, ONE, start=np.array([0.02]))
    np.testing.assert_allclose(low, 0.0105)


def test_there_is_room_for_what_is_to_be_collected_before_training():
    assert PaperConfig().num_kept == 100
    assert PaperConfig(episode_steps=60).num_kept == 167  # 10,000 steps
    assert a_search(config=replace(SMALL, collect_steps=245))._store.filmed_capacity == 21


def test_round_out_of_time_collects_once_and_makes_one_update():
    simulator = FakeSimulator()
    config = PaperConfig(**vars(SMALL) | {"updates_per_episode": 10**9})
    search, budget = a_search(simulator, config=config), Budget(1e-3)
    time.sleep(0.01)
    assert budget.is_over
    search.run_round(real_of(SPACE.nominal), budget)  # or it would never end
    assert len(simulator.played) == 10  # once for the first collection, and once for the round


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["paper", "regression"])
def test_resumed_paper_search_repeats_a_straight_one_bit_for_bit(method):
    real = real_of(np.array([0.4, 1.0]))

    def start() -> PaperSearch:
        return a_search(seed=3, method=method)

    straight = start()
    for _ in range(3):  # 25 episodes into 20 slots: the oldest are gone
        straight.run_round(real, Budget())
    tensors = {k: v.clone() for k, v in straight.tensors().items()}
    state = json.loads(json.dumps(straight.state()))
    resumed = start()
    resumed.load(tensors, state)
    torch.rand(5)  # what others draw from torch does not matter
    for _ in range(2):  # the second of them moves the mean
        one, _, one_scalars = straight.run_round(real, Budget())
        other, _, other_scalars = resumed.run_round(real, Budget())
        assert one_scalars == other_scalars
        np.testing.assert_array_equal(one.mean, other.mean)
    for name, tensor in straight.tensors().items():
        assert torch.equal(tensor, resumed.tensors()[name]), name


def test_paper_search_that_ran_no_round_can_be_saved():
    search, other = a_search(), a_search(start=SPACE.low + 0.1, seed=1)
    other.load(search.tensors(), search.state())
    np.testing.assert_array_equal(other.distribution.mean, SPACE.nominal)


def test_paper_search_replays_recorded_actions():
    simulator, real = FakeSimulator(), real_of(SPACE.nominal)
    a_search(simulator).run_round(real, Budget())
    allowed = {t.actions[:12].tobytes() for t in real}
    assert {actions.tobytes() for actions in simulator.played} == allowed


@pytest.mark.parametrize("method", ["paper", "regression"])
def test_paper_search_refuses_a_known_colour_which_it_would_move(method):
    space = ParameterSpace([a_parameter(f"card_{c}", 0.1, 1.0) for c in "rgb"])
    simulator = FakeSimulator()
    simulator.space = space
    assert a_search(simulator, space.nominal, known=np.full(3, np.nan)).num_moves == 0
    said = f"known = true, .* of card, goes with --search posterior, got {method}"
    with pytest.raises(InputError, match=said):
        a_search(simulator, space.nominal, known=space.nominal, method=method)


def test_paper_search_refuses_negative_bounds_short_episodes_and_small_pictures():
    space = ParameterSpace([a_parameter("tilt", -1.0, 1.0)])
    simulator = FakeSimulator()
    simulator.space = space
    with pytest.raises(InputError, match="tilt"):
        a_search(simulator, space.nominal)
    search = a_search()
    (trajectory, _) = real_of(SPACE.nominal)
    short = Trajectory(trajectory.frames[:3], trajectory.actions[:2], 0.1)
    with pytest.raises(InputError, match=r"^swing has 2 steps; .* at least 3: leave it out"):
        search.check([short], ["swing"])
    small = Trajectory(trajectory.frames[:, :16], trajectory.actions, 0.1)
    with pytest.raises(InputError, match=r"^episode 0, .* pictures of 20×16; expected 20×20: crop"):
        search.run_round([small], Budget())
