"""What a report marks in a film."""

import numpy as np

from simtune.before_after.unexplained import marked, unexplained


def films(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(6, 40, 60, 3) of a scene by a noisy camera whose exposure drifts, and as drawn."""
    rng = np.random.default_rng(seed)
    drawn = np.full((6, 40, 60, 3), 90, np.uint8)
    drawn[:, 10:30, 20:26] = 160
    bright = 90 + 8 * np.arange(6)[:, None, None, None] + (drawn.astype(float) - 90)
    return np.rint(bright + rng.normal(0, 2, drawn.shape)).astype(np.uint8), drawn


def test_a_hand_is_marked_and_noise_exposure_and_edges_are_not():
    real, drawn = films()
    assert not unexplained(real, drawn).any()
    aside = np.roll(drawn, 1, 2)  # edges lie one pixel aside
    assert not unexplained(real, aside).any()
    real[2, 5:15, 40:50] = [190, 140, 115]
    found = unexplained(real, drawn)
    assert found[2, 5:15, 40:50].all()
    found[2, 3:17, 38:52] = False
    assert not found.any()


def test_what_is_marked_is_orange_on_grey():
    real, drawn = films()
    real[1, 5:15, 40:50] = 250
    shown = marked(real, unexplained(real, drawn)).astype(int)
    there, elsewhere = shown[1, 8, 45], shown[1, 30, 5]
    assert there[0] > there[1] > there[2]
    assert np.ptp(elsewhere) == 0
    assert (shown <= 255).all()
