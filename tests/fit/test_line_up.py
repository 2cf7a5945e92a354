"""What is found before motion is fitted: how late actions are, where a fit begins."""

import numpy as np

from simtune.fit.line_up import clearly_best, std_of_mean


def test_a_latency_that_few_windows_favour_by_far_is_not_believed():
    misfits = np.tile(np.linspace(0.5, 6.0, 45), (3, 1))
    assert clearly_best(misfits) == 0
    # The median is lower, since some in the middle are; the others are a little worse.
    misfits[1] += np.where(np.abs(misfits[0] - 3.25) < 0.8, -1.0, 0.25)
    assert np.median(misfits[1]) < np.median(misfits[0]) - 0.5
    assert clearly_best(misfits) == 0


def test_a_latency_that_most_windows_favour_is_found_however_they_differ():
    rng = np.random.default_rng(0)
    misfits = np.tile(rng.uniform(0.5, 6.0, 45), (3, 1))
    misfits[1] += rng.normal(-0.3, 0.5, 45)
    misfits[2] += rng.normal(0.1, 0.5, 45)
    assert clearly_best(misfits) == 1
    assert clearly_best(misfits[[0, 2, 1]]) == 2
    assert clearly_best(misfits[[1, 0, 2]]) == 0


def test_a_start_is_as_sure_as_episodes_agree_but_few_may_agree_by_chance():
    before = np.array([0.2, 0.1])
    np.testing.assert_allclose(std_of_mean(np.full((1, 2), 0.5), before), before)
    # By hand: √(.04 / 2) / √2, and √((.01 + 2 · .03²) / 2) / √2
    agreeing, apart = np.array([[0.5, 0.47], [0.5, 0.53]]).T
    found = std_of_mean(np.stack([agreeing, apart], 1), before)
    np.testing.assert_allclose(found, [0.1, np.sqrt(0.0118) / 2])
    # Many episodes speak for themselves.
    many = 0.5 + 0.03 * np.random.default_rng(0).normal(size=(1000, 2))
    np.testing.assert_allclose(std_of_mean(many, before), 0.03 / np.sqrt(1000), rtol=0.1)
