"""On a GPU everything is as on a CPU, and no update waits for the host."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from batches import Same, learn_now, pixel_batch
from test_teacher_student import SMALL, SPEC, dots, make_teacher, transitions

from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.agents.student import Student
from simtune.networks.cuda_graph import graphed, make_capturable
from simtune.networks.layers import seeded
from simtune.networks.pixel_encoder import PixelEncoder
from simtune.networks.training import TrainingClock
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorConfig, PosteriorSearchParamModel
from simtune.search_param_model.posterior_batches import DetectorErrors
from simtune.search_param_model.simulated import SimulatedWorlds
from simtune.search_param_model.training_pictures import TrainingPictures
from simtune.simulation import StrayLight, random_actions
from simtune.tasks import load_task

pytestmark = pytest.mark.gpu

SIZE, KEYPOINTS, ACTIONS = 48, 3, 2
EDGES = 1e-4  # share of values that may differ: at edges rays just meet a geom, or just do not


@pytest.mark.parametrize("name", ["ball_in_cup", "walker", "cabinet_slide"])
@pytest.mark.parametrize("has_stray_light", [False, True])
def test_pictures_are_those_of_a_cpu(name, has_stray_light):
    task, rng = load_task(name), np.random.default_rng(0)
    ours, theirs = (task.simulator(image_size=SIZE, device=device) for device in ("cpu", "cuda"))
    worlds = ours.space.from_unit(rng.uniform(0.2, 0.8, (70, len(ours.space))))
    actions = random_actions(70, 4, ours.action_mapping, rng)
    states = ours.roll_out(worlds, actions, rng).states[:, -1]
    stray = StrayLight.draw(len(states), rng) if has_stray_light else StrayLight.none(len(states))
    worlds = worlds[: len(states)]
    of_cpu = ours.render(states, worlds, stray).astype(int)

    def by_gpu(num: int) -> np.ndarray:
        which = np.arange(num) % len(states)
        return theirs.render(states[which], worlds[which], stray.of(which)).astype(int)

    many = by_gpu(1000)
    difference = np.abs(of_cpu - many[: len(states)])
    assert (difference > 1).mean() < EDGES
    assert of_cpu.std() > 5  # something is seen
    np.testing.assert_array_equal(by_gpu(990), many[:990])  # fewer than fit, too
    np.testing.assert_array_equal(by_gpu(1), of_cpu[:1])  # which a CPU draws


def a_model(device: str) -> PosteriorSearchParamModel:
    visible = np.array([False, True, True, True])
    config = PosteriorConfig()
    return PosteriorSearchParamModel(
        KEYPOINTS, np.ones(ACTIONS), visible, (SIZE, SIZE), config, seed=0, device=device
    )


def pictures_of(space, num: int = 64) -> TrainingPictures:
    rng = np.random.default_rng(0)
    return TrainingPictures(
        frames=rng.integers(256, size=(num, SIZE, SIZE, 3), dtype=np.uint8),
        keypoints=rng.uniform(4, SIZE - 5, (num, KEYPOINTS, 2)).astype(np.float32),
        parameters=space.from_unit(rng.uniform(size=(num, len(space)))),
    )


@pytest.fixture
def search_range() -> Distribution:
    """Of one hidden parameter and three visible ones."""
    space = load_task("ball_in_cup").parameters
    chosen = type(space)([p for p in space if not p.is_visible][:1] + list(space)[1:4])
    return Distribution.first(chosen, chosen.nominal)


def test_losses_and_detections_are_those_of_a_cpu(search_range):
    shown = pictures_of(search_range.space)
    ours, theirs = a_model("cpu"), a_model("cuda")
    theirs.detector.load_state_dict(ours.detector.state_dict())
    found = [model.detect(shown.frames) for model in (ours, theirs)]
    for one, other in zip(*found, strict=True):  # but for ties between places
        assert (np.abs(one - other) > 0.05).mean() < 0.02


class Watched(TrainingClock):
    """Forbids waiting for the host in all updates but the first and the last ones."""

    def step(self) -> None:
        super().step()
        if self.updates == 10:
            torch.cuda.set_sync_debug_mode("error")
        if self.updates == 25:
            torch.cuda.set_sync_debug_mode("default")


def test_no_update_of_the_search_waits_for_the_host(search_range):
    model, rng = a_model("cuda"), np.random.default_rng(0)
    worlds, episodes, steps = 40, 2, 60
    seen = SimulatedWorlds(
        parameters=search_range.sample(worlds, rng),
        actions=rng.uniform(-1, 1, (worlds, episodes, steps, ACTIONS)),
        keypoints=rng.uniform(0, SIZE, (worlds, episodes, steps + 1, KEYPOINTS, 2)).astype("f4"),
    )
    off = rng.normal(size=(8, 10, KEYPOINTS, 2))
    errors = DetectorErrors(SIZE / 2 + off, off, rng.normal(size=(8, 3)))
    try:
        first = model.train_detector(pictures_of(search_range.space), search_range, Watched(30))
        loss = model.train_posterior_net(seen, search_range, errors, Watched(30))
    finally:
        torch.cuda.set_sync_debug_mode("default")
    assert np.isfinite([first, loss]).all()


def test_a_student_learns_to_see_by_graphs():
    drawn = torch.Generator("cuda").manual_seed(0)
    with seeded(0):
        student = Student(replace(SPEC, num_positions=1), SMALL.student, drawn)
    frames, places = (values.cuda() for values in dots(512))
    for i in range(150):
        at = torch.randint(512, (16,), generator=drawn, device="cuda")
        student.learn_to_see(frames[at], places[at], (places[at, 0, :1] - 16) / 6, i / 150)
    unseen, truth = dots(32, seed=1)
    seen = student.detect(unseen.cuda()).cpu()
    found = (seen[:, :4].reshape(-1, 2, 2) + 1) / 2 * unseen.shape[1]
    assert (found - truth).abs().median() < 0.5  # pixels


def test_a_teachers_updates_by_graphs_are_those_of_a_cpu():
    ours = make_teacher(noise_clip=0.0)  # without noise, which other generators draw
    theirs = copy.deepcopy(ours).cuda()
    theirs.optimizer = torch.optim.Adam(
        [*theirs.actor.parameters(), *theirs.critics.parameters()], 1e-3, fused=True
    )
    drawn = torch.Generator("cuda").manual_seed(0)
    make_capturable(theirs.optimizer, drawn.device)
    names = ("states", "actions", "rewards", "discounts", "next_states", "parameters")

    def step(*tensors: torch.Tensor) -> torch.Tensor:
        batch = replace(transitions(16), **dict(zip(names, tensors, strict=True)))
        return theirs.update(batch, 0.0, drawn)

    teach = graphed(step, drawn)
    for i in range(10):
        batch = transitions(16, seed=i)
        losses = ours.update(batch, 0.0, torch.Generator())
        others = teach(*(getattr(batch, name).cuda() for name in names))
        torch.testing.assert_close(losses, others.cpu(), rtol=1e-3, atol=1e-4)


def test_an_encoder_and_its_gradients_are_those_of_a_cpu():
    frames = torch.randint(256, (40, 3, 84, 84, 3), dtype=torch.uint8)
    torch.manual_seed(0)
    ours = PixelEncoder(9, 84)
    theirs = copy.deepcopy(ours).cuda()
    results = []
    for encoder, shown in ((ours, frames), (theirs, frames.cuda())):
        features = encoder(shown)
        (features * features.roll(1, 1)).sum().backward()
        results.append([features, *(p.grad for p in encoder.parameters())])
    for one, other in zip(*results, strict=True):
        assert (one - other.cpu()).norm() < 0.01 * one.norm()  # TF32


def test_the_papers_agent_learns_what_it_does_on_a_cpu():
    """Without chance: crops of the whole picture, hardly any noise; in bfloat16."""
    config = CurlSacConfig(
        image_size=24,
        crop_size=24,
        num_stacked=2,
        hidden_size=64,
        random_steps=0,
        log_std=(-10.0, -9.99),
    )
    ours, theirs = (CurlSac(2, config, seed=0, device=device) for device in ("cpu", "cuda"))
    here = Same(pixel_batch(24, 32))
    there, losses = here.on("cuda"), []
    for _ in range(12):  # six of each kind, three of which are not graphs yet
        losses = [[*learn_now(one, by).values()] for one, by in ((ours, here), (theirs, there))]
    np.testing.assert_allclose(*losses, rtol=0.1, atol=0.05)
    assert here.batch.frames is not None
    shown = here.batch.frames[:8].numpy()
    np.testing.assert_allclose(ours.act(shown), theirs.act(shown), atol=0.05)


def test_acting_by_graphs_is_plain_acting():
    """After the capture too, on other pictures, after updates, and after a checkpoint."""
    config = CurlSacConfig(
        image_size=24, crop_size=20, num_stacked=2, hidden_size=64, random_steps=0
    )
    by_graphs, plain = (
        CurlSac(2, config, seed=0, device="cuda", use_graphs=use) for use in (True, False)
    )
    there = Same(pixel_batch(24, 32)).on("cuda")
    for i in range(6):
        shown = torch.randint(256, (3, 2, 24, 24, 3), dtype=torch.uint8).numpy()
        np.testing.assert_allclose(by_graphs.act(shown), plain.act(shown), atol=0.02)
        if i == 4:
            learn_now(by_graphs, there)
            plain.load(by_graphs.tensors(), by_graphs.state())
            by_graphs.load(plain.tensors(), plain.state())
    samples = [by_graphs.act(shown, sample=True) for _ in range(8)]
    assert len(np.unique(samples)) == np.size(samples)
