"""How far off moving parts are, by hand; and that a world's own replay is not off at all."""

import json

import numpy as np
import pytest

from simtune.before_after.moving_parts import MovingParts, follow_parts
from simtune.tasks import load_task
from simtune.trajectory import seen_late
from simtune.vision.detections import Detections
from simtune.vision.keypoints import every_keypoint


def parts_of(off_before, off_after) -> MovingParts:
    """One keypoint that stands still, and is off by so many pixels to the right."""
    detected = np.zeros((len(off_after), 1, 2))
    aside = [np.array([[[off, 0]] for off in its]) for its in (off_before, off_after)]
    before, after = (detected + its for its in aside)
    return MovingParts(("arm",), detected, before, after)


def test_medians_and_how_long_a_part_is_followed_by_hand():
    off = [
        0,
        1,
        1,
        9,
        1,
        1,
        4,
        5,
        6,
        7,
    ]  # slips once, is lost from picture 6 on
    (scores,) = parts_of([3] * 10, off).scores().values()
    assert scores["px_before"] == 3
    assert scores["px"] == np.median(off)
    assert (scores["end_px_before"], scores["end_px"]) == (3, 7)
    assert (scores["pictures_along_before"], scores["pictures_along"]) == (0, 6)
    (scores,) = parts_of([0] * 10, [0] * 10).scores().values()
    assert scores["pictures_along"] is None


def test_how_long_a_part_is_followed_counts_pictures_that_do_not_show_it():
    off = np.repeat([0, 1, 5, 6, 7], 2) * np.tile([1, np.nan], 5)  # is seen in every other one
    (scores,) = parts_of([0] * 10, off).scores().values()
    assert scores["pictures_along"] == 4


def test_a_part_is_off_by_what_its_seen_keypoints_are():
    detected = np.array([[[0, 0], [0, 0], [5, 5]], [[np.nan] * 2, [0, 0], [np.nan] * 2]], float)
    simulated = np.array([[[3, 4], [0, 0], [5, 5]], [[9, 9], [0, 2], [5, 5]]], float)
    distances = MovingParts(("arm", "arm", "cup"), detected, simulated, simulated).distances()
    np.testing.assert_allclose(distances["arm"]["after"], [np.sqrt(25 / 2), 2])
    np.testing.assert_allclose(distances["cup"]["before"], [0, np.nan])


def test_what_is_written_is_read_again():
    known = parts_of([1.25, 2], [0, np.nan])
    back = MovingParts.from_json(json.loads(json.dumps(known.to_json())))
    assert back.parts == known.parts
    np.testing.assert_array_equal(back.before, known.before)
    np.testing.assert_array_equal(back.after, known.after)
    with pytest.raises(ValueError, match="keypoints"):
        MovingParts.from_json(known.to_json() | {"parts": ["arm", "cup"]})


def test_the_true_world_follows_its_own_film_and_another_does_not():
    task = load_task("cartpole")
    simulator, rng = task.simulator(image_size=64), np.random.default_rng(0)
    truth, other = task.parameters.nominal, task.parameters.nominal * [1, 2, *[1] * 6]
    keypoints = every_keypoint(simulator)
    actions = rng.uniform(-1, 1, (20, 1))
    real = simulator.roll_out(truth[None], actions[None], rng, keypoints.observe)
    seen = real.observed[0].reshape(21, 1, -1, 2).repeat(2, 1)
    sure = np.ones(seen.shape[:-1])
    sure[3] = 0.1  # hidden in one picture
    detections = Detections(seen[:, 0], seen, sure, np.ones_like(seen), np.zeros((21, 0)))
    parts = follow_parts(
        simulator, keypoints, detections, actions, real.states[0, 0], (other, truth)
    )
    assert set(parts.parts) == {"cart", "pole_1"}
    assert np.isnan(parts.detected[3]).all()
    for scores in parts.scores().values():
        assert scores["px"] < 1e-3
        assert scores["pictures_along"] is None
        assert scores["px_before"] > 0.1
    shown = seen_late(seen[:, 0].reshape(21, -1), 0.5).reshape(21, -1, 2)
    late = detections._replace(keypoints=shown)
    pixels = {}
    for steps in (0.0, 0.5):  # pictures are late: so are those of the simulator, if that is known
        found = follow_parts(
            simulator, keypoints, late, actions, real.states[0, 0], (other, truth), steps
        )
        pixels[steps] = max(its["px"] for its in found.scores().values())
    assert pixels[0.5] < 1e-3 < 0.1 < pixels[0.0]
