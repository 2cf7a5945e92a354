"""Detector and posterior network: by hand, by plain loops, against a posterior that is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from simtune.networks.training import TrainingClock
from simtune.parameters import Parameter, ParameterSpace
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorConfig, PosteriorSearchParamModel
from simtune.search_param_model.posterior_batches import DetectorErrors, PosteriorBatches
from simtune.search_param_model.posterior_net import (
    SHORTEST_STEPS,
    PosteriorNet,
    PosteriorNetConfig,
    SurvivalMixture,
    posterior_loss,
)
from simtune.search_param_model.simulated import FilmedWorlds
from simtune.search_param_model.training_pictures import TrainingPictures
from simtune.vision.detector import (
    Detections,
    DetectorConfig,
    KeypointDetector,
    detect,
    splat,
    to_input,
)
from simtune.vision.image_noise import ImageNoise

SMALL_DETECTOR = DetectorConfig(channels=4, free_maps=2, hidden=16, batch_size=16)
SIZE = 32  # pixels


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def a_detector(num_keypoints=2, num_visible=3, size=SIZE) -> KeypointDetector:
    torch.manual_seed(0)
    return KeypointDetector(num_keypoints, num_visible, (size, size), SMALL_DETECTOR)


def a_parameter(name: str, field: str, low=0.0, high=1.0, scale="linear") -> Parameter:
    nominal = (low * high) ** 0.5 if scale == "log" else (low + high) / 2
    return Parameter(
        name=name, field=field, nominal=nominal, low=low, high=high, scale=scale, unit="1"
    )


# --- the detector -------------------------------------------------------------------------


def test_splat_by_hand():
    # Cells of 2 pixels: the first cell's centre lies at pixel 0.5, the next one's at 2.5.
    keypoints = torch.tensor([[[0.5, 0.5], [1.5, 0.5], [3.0, 5.0], [-9.0, 99.0]]])
    weights = splat(keypoints, (4, 4)).view(4, 4, 4)  # keypoint, y, x
    expected = torch.zeros(4, 4, 4)
    expected[0, 0, 0] = 1
    expected[1, 0, 0] = expected[1, 0, 1] = 0.5
    for x, weight_x in ((1, 0.75), (2, 0.25)):  # 3.0 is cell 1.25, 5.0 is cell 2.25
        for y, weight_y in ((2, 0.75), (3, 0.25)):
            expected[2, y, x] = weight_x * weight_y
    expected[3, 3, 0] = 1  # out of the picture: the nearest corner
    torch.testing.assert_close(weights, expected)


def test_splat_keeps_the_mean_position():
    detector = a_detector(1)
    keypoints = torch.rand(50, 1, 2, generator=generator()) * (SIZE - 2) + 0.5
    weights = splat(keypoints, detector.cells)
    torch.testing.assert_close(weights.sum(-1), torch.ones(50, 1))
    torch.testing.assert_close(weights @ detector.grid, keypoints)


@pytest.mark.parametrize("truth", [(10.3, 20.9), (4.0, 27.2), (15.5, 15.5), (0.6, 30.4)])
def test_peaks_are_found_finer_than_a_cell(truth):
    detector = a_detector(1)
    heatmap = splat(torch.tensor([[truth]]), detector.cells).log().clamp(min=-20)
    heatmap[..., 0 if truth[0] > 8 else -1] = heatmap.max() - 0.1  # a lower peak far away
    candidates, *_ = detector.candidates(heatmap)
    np.testing.assert_allclose(candidates[0, 0, 0], truth, atol=0.1)  # a cell is 2 pixels


def test_input_is_between_minus_one_and_one_in_the_order_of_torch():
    frames = np.zeros((2, 4, 5, 3), np.uint8)
    frames[1, 2, 3] = (0, 51, 255)
    pictures = to_input(frames)
    assert pictures.shape == (2, 3, 4, 5)
    np.testing.assert_allclose(pictures[1, :, 2, 3], [-1, 51 / 127.5 - 1, 1])
    assert (pictures[0] == -1).all()


def test_all_that_a_detector_computes_stays_on_its_device():
    """Torch's device without memory stands for a GPU: it refuses what lies on the CPU."""
    detector = KeypointDetector(3, 4, (32, 32), DetectorConfig()).to("meta")
    heatmaps, _ = detector(torch.empty(2, 3, 32, 32, device="meta"))
    assert {part.device.type for part in detector.candidates(heatmaps)} == {"meta"}
    sizes = (2, 3, 32, 32), (2, 3, 2), (2, 4), (4,)
    loss = detector.loss(*(torch.empty(size, device="meta") for size in sizes))
    assert loss.device.type == "meta"


def test_detection_in_batches_equals_detection_at_once(monkeypatch):
    detector = a_detector()
    frames = np.random.default_rng(0).integers(256, size=(7, SIZE, SIZE, 3)).astype(np.uint8)
    whole = detect(detector, frames)
    monkeypatch.setattr("simtune.vision.detector.pictures_at_once", lambda *_: 3)
    for at_once, in_batches in zip(whole, detect(detector, frames), strict=True):
        np.testing.assert_allclose(at_once, in_batches, atol=1e-4)


@pytest.mark.parametrize(("num_keypoints", "num_visible"), [(0, 2), (2, 0)])
def test_detector_learns_without_keypoints_or_without_visible_parameters(
    num_keypoints, num_visible
):
    detector = a_detector(num_keypoints, num_visible)
    loss = detector.loss(
        torch.zeros(4, 3, SIZE, SIZE),
        torch.full((4, num_keypoints, 2), 7.0),
        torch.full((4, num_visible), 0.5),
        torch.ones(num_visible),
    )
    loss.backward()
    assert torch.isfinite(loss)


def test_detector_loss_is_relative_to_the_width_of_the_range():
    detector = a_detector(0, 1)
    pictures, keypoints = torch.zeros(1, 3, SIZE, SIZE), torch.zeros(1, 0, 2)
    _, estimated = detector(pictures)
    truth = (estimated + 1.0).detach()  # far away, where the loss is linear
    wide, narrow = (
        detector.loss(pictures, keypoints, truth, torch.tensor([w])).item() for w in (1.0, 0.5)
    )
    # smooth L1 of an error of 2/width with beta .1
    expected = (4.0 - 0.05) / (2.0 - 0.05)
    assert narrow / wide == pytest.approx(expected, rel=1e-4)


def test_a_detector_that_reads_rows_hands_their_means_to_its_head():
    pictures = to_input(np.random.default_rng(0).integers(0, 256, (2, 16, 24, 3), np.uint8))

    def read_by(detector: KeypointDetector) -> torch.Tensor:
        seen = []
        assert detector.head is not None
        detector.head.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
        detector(pictures)
        return seen[0]

    config = DetectorConfig(channels=4, free_maps=1)
    detector = KeypointDetector(1, 2, (16, 24), replace(config, reads_rows=True))
    read = read_by(detector)
    fine, _ = detector._features(pictures)
    torch.testing.assert_close(read[:, -4 * 8 :].unflatten(1, (4, 8)), fine.mean(3))
    without = read_by(KeypointDetector(1, 2, (16, 24), config))
    assert read.shape[1] - without.shape[1] == 4 * 8, "channels of eight rows of cells"


def test_a_detector_that_rounds_finds_the_same_and_learns_in_float32(monkeypatch):
    """Its features have the 8 bits of bfloat16; its maps and its gradients all 24."""
    pictures = to_input(np.random.default_rng(0).integers(0, 256, (4, 16, 24, 3), np.uint8))
    fine, rounded = (
        KeypointDetector(2, 3, (16, 24), replace(SMALL_DETECTOR, uses_bfloat16=rounds))
        for rounds in (False, True)
    )
    rounded.load_state_dict(fine.state_dict())

    def learn(detector: KeypointDetector, is_fast: bool) -> tuple[torch.Tensor, torch.Tensor]:
        monkeypatch.setattr("simtune.networks.layers.has_fast_bf16", lambda device: is_fast)
        heatmaps, visible = detector(pictures)
        assert heatmaps.dtype == visible.dtype == torch.float32
        detector.zero_grad()
        detector.loss(
            pictures, torch.full((4, 2, 2), 7.3), torch.ones(4, 3), torch.ones(3)
        ).backward()
        gradients = [weight.grad for weight in detector.parameters() if weight.grad is not None]
        assert {gradient.dtype for gradient in gradients} == {torch.float32}
        return heatmaps.detach(), torch.cat([gradient.flatten() for gradient in gradients])

    (exact, wanted), (near, got) = learn(fine, True), learn(rounded, True)
    away = (near - exact).norm() / exact.std() / exact.numel() ** 0.5
    assert 1e-5 < away < 0.02
    assert torch.cosine_similarity(got, wanted, dim=0) > 0.99
    assert torch.equal(learn(rounded, False)[0], exact), "where bfloat16 is not faster"


def dots(num: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pictures of a blurred dot on a ground of some grey: positions (n, 1, 2), grey (n, 1)."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(5, SIZE - 6, (num, 1, 2))
    grey = rng.uniform(0, 0.5, (num, 1))
    axis = np.arange(SIZE)
    distance = (axis - place[:, 0, :1]) ** 2 + 0j  # (n, SIZE), x
    distance = distance.real[:, None, :] + ((axis - place[:, 0, 1:]) ** 2)[:, :, None]
    picture = np.maximum(grey[:, :, None], np.exp(-distance / 4))
    return (np.repeat(picture[..., None], 3, -1) * 255).astype(np.uint8), place, grey


@pytest.mark.thorough
def test_detector_learns_to_find_a_dot_and_a_grey():
    space = ParameterSpace([a_parameter("grey", "geom_rgba"), a_parameter("mass", "body_mass")])
    distribution = Distribution(space, np.full(2, 0.25), np.zeros(2), np.array([0.5, 1.0]))
    config = PosteriorConfig(
        detector=DetectorConfig(channels=8, free_maps=2, hidden=32, batch_size=32)
    )
    model = PosteriorSearchParamModel(1, np.ones(1), space.is_visible, (SIZE, SIZE), config, seed=0)

    def worlds(seed: int) -> FilmedWorlds:
        frames, place, grey = dots(300, seed)
        return FilmedWorlds(
            np.concatenate([grey, np.full((300, 1), 0.5)], 1),
            np.zeros((300, 1, 1, 1), np.float32),
            np.repeat(place[:, None, None].astype(np.float32), 2, 2),
            frames[:, None],
            np.zeros(300, int),
            np.zeros((300, 1, 1)),
        )

    seen = worlds(0)
    pictures = TrainingPictures(seen.frames[:, 0], seen.filmed_keypoints()[:, 0], seen.parameters)
    loss = model.train_detector(pictures, distribution, TrainingClock(250))
    assert np.isfinite(loss)
    others = worlds(1)
    errors = model.detector_errors(others, model.detect(others.frames), distribution)
    assert errors.keypoints.shape == (300, 1, 1, 2)
    assert errors.visible.shape == (300, 1)
    assert np.median(np.abs(errors.keypoints)) < 0.5
    # In coordinates of the range, which is 1 wide: knowing nothing would leave an error of .25.
    assert np.median(np.abs(errors.visible)) < 0.06


# --- curves -------------------------------------------------------------------------------


def some_curves(worlds=2, parameters=3, components=3) -> SurvivalMixture:
    g = generator(3)
    shape = (worlds, parameters, components)
    return SurvivalMixture(
        torch.randn(shape, generator=g).log_softmax(-1),
        torch.randn(shape, generator=g) * 0.6,
        torch.rand(shape, generator=g) * 0.3 + 0.02,
    )


def survival(curves: SurvivalMixture, world: int, parameter: int, candidate: float) -> float:
    """P(truth > candidate), by a plain loop."""
    total = 0.0
    for k in range(curves.locations.shape[-1]):
        weight = math.exp(curves.log_weights[world, parameter, k])
        its = (curves.locations, curves.scales)
        location, scale = (x[world, parameter, k].item() for x in its)
        total += weight / (1 + math.exp((candidate - location) / scale))
    return total


def test_curves_are_mixtures_of_logistics():
    curves = some_curves()
    candidates = torch.linspace(-2, 2, 9).expand(2, 3, -1)
    prob_higher = curves.prob_higher(candidates)
    for world in range(2):
        for parameter in range(3):
            expected = [survival(curves, world, parameter, c) for c in np.linspace(-2, 2, 9)]
            np.testing.assert_allclose(prob_higher[world, parameter], expected, atol=2e-5)


def test_curves_fall_from_one_to_zero():
    prob_higher = some_curves().prob_higher(torch.linspace(-9, 9, 500).expand(2, 3, -1))
    assert (prob_higher.diff(dim=-1) <= 0).all()
    assert (prob_higher[..., 0] > 0.999).all()
    assert (prob_higher[..., -1] < 0.001).all()
    assert ((prob_higher > 0) & (prob_higher < 1)).all()  # or the loss would be infinite


def test_samples_follow_the_curve():
    curves = some_curves()
    num = 20_000
    samples = curves.sample(num, generator()).sort(-1).values
    below = 1 - curves.prob_higher(samples)
    uniform = (torch.arange(num) + 0.5) / num
    distance = (below - uniform).abs().amax(-1)  # Kolmogorov and Smirnov's
    assert (distance < 1.95 / num**0.5).all()  # exceeded once in a thousand


# --- the posterior network ----------------------------------------------------------------


def certain(truth: float) -> SurvivalMixture:
    """Curves that are sure of the truth."""
    location = torch.full((1, 1, 1), truth)
    return SurvivalMixture(torch.zeros(1, 1, 1), location, torch.full((1, 1, 1), 5e-4))


def test_a_curve_that_is_right_has_less_loss():
    truth = torch.tensor([[0.75]])
    right, opposite, higher = (
        posterior_loss(certain(p), truth, 2000, generator()).item() for p in (0.75, 0.25, 0.85)
    )
    assert right < 0.2 < higher < opposite


def test_label_is_true_where_the_truth_is_higher(monkeypatch):
    asked = []

    def prob_higher(self, candidates):
        asked.append(candidates)
        return (candidates < 0.65).float() * 0.98 + 0.01  # sure that the truth is 0.65

    monkeypatch.setattr(SurvivalMixture, "prob_higher", prob_higher)
    loss = posterior_loss(certain(0.5), torch.tensor([[0.65]]), 500, generator())
    assert loss.item() == pytest.approx(-math.log(0.99), rel=1e-4)
    (candidates,) = asked
    assert candidates.shape == (1, 1, 1000)
    assert candidates.min() < 0  # they cover the range and a little more
    assert candidates.max() > 1


def test_candidates_do_not_depend_on_the_truth(monkeypatch):
    asked = []
    monkeypatch.setattr(
        SurvivalMixture, "prob_higher", lambda _, c: asked.append(c) or torch.full_like(c, 0.5)
    )
    for truth in (0.05, 0.95):
        posterior_loss(certain(0.55), torch.tensor([[truth]]), 50, generator())
    assert torch.equal(*asked)


def test_posterior_net_takes_any_number_of_episodes_and_steps():
    torch.manual_seed(0)
    posterior_net = PosteriorNet(5, [1], 3, PosteriorNetConfig(channels=8, hidden=16))
    for episodes, steps in ((1, SHORTEST_STEPS), (4, 30)):
        seen = torch.randn(2, episodes, steps, 5)
        curves = posterior_net(seen, torch.zeros(2, 1))
        assert curves.locations.shape == (2, 3, 3)
        order = torch.randperm(episodes)
        again = posterior_net(seen[:, order], torch.zeros(2, 1))
        torch.testing.assert_close(curves.locations, again.locations)  # a set has no order
    with pytest.raises(RuntimeError):
        posterior_net(torch.randn(2, 1, SHORTEST_STEPS - 1, 5), torch.zeros(2, 1))


def test_visible_estimate_moves_its_curve_along():
    posterior_net = PosteriorNet(5, [1], 3, PosteriorNetConfig(channels=8, hidden=16))
    for parameter in posterior_net.head.parameters():
        torch.nn.init.zeros_(parameter)  # no corrections learnt yet
    curves = posterior_net(torch.randn(1, 1, 30, 5), torch.tensor([[0.85]]))
    torch.testing.assert_close(curves.locations.mean(-1), torch.tensor([[0.5, 0.85, 0.5]]))


NOISE = 0.25  # of an observation; the truth is uniform in [0, 1]
STEPS = SHORTEST_STEPS


def observe(truth: torch.Tensor, episodes: int, seed: int) -> torch.Tensor:
    """(B, 1) truths to (B, E, T, 1): each episode shows the truth plus noise, all along.

    Scaled, as motion is, to about 1 in size.
    """
    noise = torch.randn(len(truth), episodes, generator=generator(seed)) * NOISE
    return (2 * (truth + noise) - 1)[..., None, None].expand(-1, -1, STEPS, 1)


def analytic(seen: torch.Tensor, grid: np.ndarray) -> np.ndarray:
    """(B, G) distribution functions of the posterior."""
    mean, episodes = (seen[:, :, 0, 0].mean(1).numpy() + 1) / 2, seen.shape[1]
    density = np.exp(-episodes * (grid - mean[:, None]) ** 2 / 2 / NOISE**2)
    density *= np.abs(grid - 0.5) <= 0.5
    below = density.cumsum(1)
    return below / below[:, -1:]


@pytest.fixture(scope="module")
def net_of_a_known_posterior() -> PosteriorNet:
    torch.manual_seed(0)
    config = PosteriorNetConfig(channels=16, hidden=48, weight_decay=0.0)
    posterior_net = PosteriorNet(1, [], 1, config)
    posterior_net.most_episodes.fill_(4)
    updates = 500
    optimizer = torch.optim.AdamW(posterior_net.parameters(), weight_decay=0.0)
    for update in range(updates):
        optimizer.param_groups[0]["lr"] = 6e-3 * (1 - update / updates)
        truth = torch.rand(96, 1, generator=generator(update))
        seen = observe(truth, 1 + update % 4, update + 10_000)
        curves = posterior_net(seen, torch.zeros(96, 0))
        loss = posterior_loss(curves, truth, 48, generator(update))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return posterior_net


@pytest.mark.thorough
@torch.no_grad()
@pytest.mark.parametrize("episodes", [1, 4])
def test_trained_posterior_net_gives_the_analytic_posterior(net_of_a_known_posterior, episodes):
    truth = torch.rand(800, 1, generator=generator(1))
    seen = observe(truth, episodes, 2)
    curves = net_of_a_known_posterior(seen, torch.zeros(800, 0))
    grid = np.linspace(-0.25, 1.25, 601)
    candidates = torch.tensor(grid, dtype=torch.float32).expand(800, 1, -1)
    below = 1 - curves.prob_higher(candidates)[:, 0].numpy()
    expected = analytic(seen, grid)

    def quantiles(rows, share):
        return np.array([np.interp(share, row, grid) for row in rows])

    for share, tolerance in ((0.5, 0.03), (0.05, 0.05), (0.95, 0.05)):
        error = np.abs(quantiles(below, share) - quantiles(expected, share))
        assert np.median(error) < tolerance, share
    low, high = quantiles(below, 0.05), quantiles(below, 0.95)
    covered = np.mean((truth[:, 0].numpy() > low) & (truth[:, 0].numpy() < high))
    assert 0.86 < covered < 0.95


@pytest.mark.thorough
@torch.no_grad()
def test_more_episodes_than_in_training_count_as_many_as_in_training(net_of_a_known_posterior):
    seen = observe(torch.full((3, 1), 0.5), 1, 5)
    four, nine = (
        net_of_a_known_posterior(seen.repeat(1, n, 1, 1), torch.zeros(3, 0)).scales for n in (4, 9)
    )
    np.testing.assert_allclose(nine, four, rtol=1e-5)


@pytest.mark.thorough
@torch.no_grad()
def test_more_episodes_narrow_the_interval(net_of_a_known_posterior):
    truth = torch.rand(400, 1, generator=generator(3)) * 0.3 + 0.35  # away from the edges
    widths = []
    for episodes in (1, 4):
        curves = net_of_a_known_posterior(observe(truth, episodes, 4), torch.zeros(400, 0))
        samples = curves.sample(2000, generator())[:, 0]
        widths.append((samples.quantile(0.75, 1) - samples.quantile(0.25, 1)).median())
    # As 1/sqrt(E), but that the prior narrows the interval of a single episode as well.
    assert 1.4 < widths[0] / widths[1] < 2.3


# --- both ---------------------------------------------------------------------------------


def a_model_and_worlds(num_worlds=12, episodes=2, steps=30, filmed=5):
    space = ParameterSpace(
        [
            a_parameter("grey", "geom_rgba"),
            a_parameter("mass", "body_mass", 0.1, 10.0, "log"),
            a_parameter("red", "geom_rgba"),
        ]
    )
    low, high = np.array([0.2, 1.0, 0.0]), np.array([0.4, 10.0, 1.0])
    distribution = Distribution(space, (low + high) / 2, low, high)
    rng = np.random.default_rng(0)
    config = PosteriorConfig(
        detector=SMALL_DETECTOR,
        posterior_net=PosteriorNetConfig(channels=8, hidden=16, batch_size=8, candidates=8),
    )
    model = PosteriorSearchParamModel(2, np.ones(1), space.is_visible, (SIZE, SIZE), config, seed=0)
    worlds = FilmedWorlds(
        distribution.sample(num_worlds, rng),
        rng.uniform(-1, 1, (num_worlds, episodes, steps, 1)),
        rng.uniform(0, SIZE, (num_worlds, episodes, steps + 1, 2, 2)).astype(np.float32),
        rng.integers(256, size=(num_worlds, filmed, SIZE, SIZE, 3)).astype(np.uint8),
        rng.integers(0, steps + 2 - filmed, num_worlds),
        np.zeros((num_worlds, filmed, 1)),
    )
    return model, worlds, distribution


def test_filmed_keypoints_are_those_of_the_filmed_steps():
    _, worlds, _ = a_model_and_worlds()
    filmed = worlds.filmed_keypoints()
    for world, start in enumerate(worlds.filmed_from):
        for i in range(5):
            np.testing.assert_array_equal(filmed[world, i], worlds.keypoints[world, 0, start + i])


def test_detectors_estimates_are_compared_in_coordinates_of_the_range():
    model, worlds, distribution = a_model_and_worlds(num_worlds=2, filmed=2)
    worlds.parameters[:, [0, 2]] = [[0.2, 0.25], [0.35, 1.0]]  # 0 and .75 of the range; .25 and 1
    # In coordinates of the whole space, which the two frames of each world average to
    visible = np.array([[0.15, 0.5], [0.25, 0.6], [0.3, 0.9], [0.4, 0.9]])
    found = worlds.filmed_keypoints().reshape(4, 2, 2) + np.array([1.0, -2.0])
    detections = Detections(
        found, np.zeros((4, 2, 2, 2)), np.zeros((4, 2, 2)), np.zeros((4, 2, 2, 2)), visible
    )
    errors = model.detector_errors(worlds, detections, distribution)
    np.testing.assert_allclose(errors.visible, [[0, 0.3], [0, -0.1]], atol=1e-6)
    expected = np.broadcast_to([1.0, -2.0], (2, 2, 2, 2))
    np.testing.assert_allclose(errors.keypoints, expected, atol=1e-5)


def test_posterior_batches_hold_stretches_with_errors_of_poses_like_theirs():
    model, worlds, distribution = a_model_and_worlds()
    # Held-out poses are far to the left or far to the right, and errors say which: +1000, +2000
    x = torch.from_numpy(worlds.keypoints)[..., 0]
    middle = float(x.median())
    poses = np.stack([np.full((8, 2, 2), middle - 30), np.full((8, 2, 2), middle + 30)])
    poses[..., 1] = float(worlds.keypoints[..., 1].mean())
    errors = np.zeros((2, 8, 2, 2)) + 1000.0 * np.arange(1, 3)[:, None, None, None]
    visible_errors = np.tile(np.arange(1, 3)[:, None] * 10.0, (1, 2))
    batches = PosteriorBatches(
        worlds,
        DetectorErrors(poses, errors, visible_errors),
        model.visible,
        model.config.posterior_net,
        model.generator,
    )
    truth = torch.tensor(distribution.to_range_unit(worlds.parameters), dtype=torch.float32)
    sizes, seen = set(), set()
    for _ in range(20):
        at, keypoints, actions, visible = batches.draw(truth)
        num, steps = actions.shape[1:3]
        sizes.add(num)
        assert keypoints.shape == (8, num, steps + 1, 2, 2)
        assert SHORTEST_STEPS <= steps <= 30
        misled = (keypoints / 1000).floor()
        assert (misled == misled[..., :1, :1]).all()
        clean = keypoints - 1000 * misled
        off = visible - truth[at][:, model.visible]
        assert set(off.flatten().round().tolist()) <= {10.0, 20.0}
        for b in range(8):  # each is a stretch of an episode of that very world
            world = torch.from_numpy(worlds.keypoints[at[b]])
            starts = [
                (e, t)
                for e in range(2)
                for t in range(31 - steps)
                if torch.allclose(world[e, t : t + steps + 1], clean[b, 0], atol=1e-2)
            ]
            assert len(starts) == 1
            ((e, t),) = starts
            played = torch.from_numpy(worlds.actions[at[b], e, t : t + steps]).float()
            torch.testing.assert_close(actions[b, 0], played)
            looked_at = world[e, (torch.arange(t, t + steps + 1) // 2) * 2]
            nearer = (looked_at[..., 0] - middle).mean(-1) > 0
            assert misled[b, 0, :, 0, 0].tolist() == (1.0 + nearer.float()).tolist()
            seen |= set(misled[b, 0, :, 0, 0].tolist())
    assert sizes == {1, 2}
    assert seen == {1.0, 2.0}


def test_an_update_by_longer_episodes_takes_no_longer(monkeypatch):
    """Crops of more steps than limit it are of fewer worlds; of fewer steps, as ever."""
    model, worlds, distribution = a_model_and_worlds()
    errors = DetectorErrors(np.zeros((2, 8, 2, 2)), np.zeros((2, 8, 2, 2)), np.zeros((2, 2)))
    drawn = {}
    for limit in (400, 26):
        monkeypatch.setattr("simtune.search_param_model.posterior_batches._MAX_TOTAL_STEPS", limit)
        model.generator.manual_seed(0)
        config = replace(model.config.posterior_net, crop_lengths=4, shortest_crop=21)
        batches = PosteriorBatches(worlds, errors, model.visible, config, model.generator)
        truth = torch.tensor(distribution.to_range_unit(worlds.parameters), dtype=torch.float32)
        drawn[limit] = [batches.draw(truth) for _ in range(20)]
    sizes = {(its.shape[2], len(its)) for _, _, its, _ in drawn[26]}
    assert sizes == {(21, 8), (24, 8), (27, 7), (30, 6)}
    assert {len(its) for _, _, its, _ in drawn[400]} == {8}
    first, same = (drawn[limit][0] for limit in (400, 26))
    torch.testing.assert_close(first[0][: len(same[0])], same[0])


def test_curves_do_not_depend_on_the_order_of_episodes():
    model, worlds, distribution = a_model_and_worlds()
    first = worlds.frames[:, 0], worlds.filmed_keypoints()[:, 0], worlds.parameters
    pictures = TrainingPictures(*first)
    assert np.isfinite(model.train_detector(pictures, distribution, TrainingClock(3)))
    errors = model.detector_errors(worlds, model.detect(worlds.frames), distribution)
    assert np.isfinite(model.train_posterior_net(worlds, distribution, errors, TrainingClock(3)))
    rng = np.random.default_rng(0)
    episodes = [
        model.detect(rng.integers(256, size=(steps + 1, SIZE, SIZE, 3)).astype(np.uint8))
        for steps in (30, 26)  # recordings differ in length
    ]
    actions = rng.uniform(-1, 1, (2, 26, 1))
    curves = model.curves(episodes, actions, distribution)
    assert curves.locations.shape == (1, 3, 3)
    swapped = model.curves(episodes[::-1], actions[::-1].copy(), distribution)
    torch.testing.assert_close(curves.locations, swapped.locations)
    mixed_up = model.curves(episodes[::-1], actions, distribution)
    assert not torch.equal(curves.locations, mixed_up.locations), "each goes with its own actions"


def test_seed_gives_the_same_model_and_leaves_torchs_own_numbers_alone():
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    (one, _, _), (other, _, _) = a_model_and_worlds(), a_model_and_worlds()
    assert torch.equal(torch.rand(3), expected)
    for a, b in zip(one.detector.parameters(), other.detector.parameters(), strict=True):
        assert torch.equal(a, b)
    for a, b in zip(one.posterior_net.parameters(), other.posterior_net.parameters(), strict=True):
        assert torch.equal(a, b)


def test_gradients_reach_every_weight_of_the_detector():
    detector = a_detector()
    pictures = torch.rand(4, 3, SIZE, SIZE, generator=generator()) * 2 - 1
    keypoints = torch.rand(4, 2, 2, generator=generator()) * SIZE
    detector.loss(pictures, keypoints, torch.rand(4, 3), torch.ones(3)).backward()
    for name, weight in detector.named_parameters():
        assert weight.grad is not None, name
        assert F.l1_loss(weight.grad, torch.zeros_like(weight)) > 0, name


def test_keypoint_that_may_be_in_two_places_gets_both_as_candidates():
    detector = KeypointDetector(1, 0, (SIZE, SIZE), SMALL_DETECTOR)
    heat = torch.full((1, 1, SIZE**2 // 4), -20.0)
    left, right = 2 * detector.cells[1] + 2, 9 * detector.cells[1] + 10  # cells far from each other
    heat[0, 0, left], heat[0, 0, right] = math.log(0.7), math.log(0.3)
    places, probability, _ = detector.candidates(heat)
    torch.testing.assert_close(places[0, 0, 0], detector.grid[left], atol=0.01, rtol=0)
    torch.testing.assert_close(places[0, 1, 0], detector.grid[right], atol=0.01, rtol=0)
    torch.testing.assert_close(probability[0, :, 0], torch.tensor([0.7, 0.3]), atol=1e-3, rtol=0)


def test_candidates_are_what_sums_over_masked_heatmaps_give():
    """By the definition, cell by cell, with peaks anywhere, at the edges as well."""
    detector = KeypointDetector(3, 0, (16, 20), SMALL_DETECTOR)  # 8 rows of 10 cells
    heat = 3 * torch.randn(20, 3, 80, generator=generator())
    places, probability, spread = detector.candidates(heat)
    row, column = np.divmod(np.arange(80), 10)
    for b, keypoint in np.ndindex(20, 3):
        logits = heat[b, keypoint].double().numpy()
        share, left = np.exp(logits) / np.exp(logits).sum(), np.ones(80, bool)
        for rank in range(2):
            peak = np.argmax(np.where(left, share, -1))
            near = (abs(row - row[peak]) <= 2) & (abs(column - column[peak]) <= 2) & left
            left &= ~near
            weight = (share * near / share[near].sum())[:, None]
            at = detector.grid.double().numpy()
            mean = (weight * at).sum(0)
            part = (mean - at[0]) / 2 % 1
            variance = (weight * (at - mean) ** 2).sum(0) - 4 * part * (1 - part)
            assert probability[b, rank, keypoint] == pytest.approx(share[near].sum(), rel=1e-4)
            np.testing.assert_allclose(places[b, rank, keypoint], mean, atol=1e-3)
            std = np.sqrt(np.maximum(variance, 0))
            np.testing.assert_allclose(spread[b, rank, keypoint], std, atol=0.01)


def test_image_noise_differs_from_world_to_world_and_not_within_one():
    rng = np.random.default_rng(0)
    drawn = np.full((6, 3, 8, 8, 3), 128, np.uint8)
    filmed = drawn.copy()
    ImageNoise(noise=0.0).apply(filmed, rng)
    levels = filmed.mean((2, 3))  # (W, F, 3)
    assert (np.ptp(levels, axis=1) == 0).all()
    assert levels[:, 0, 0].std() > 2
    assert abs(levels.mean() - 128) < 20
    noisy = drawn.copy()
    ImageNoise(gain=0, tint=0, offset=0, noise=0.05).apply(noisy, rng)
    assert 0.5 < noisy.std((1, 2, 3, 4)).mean() < 0.05 * 255
