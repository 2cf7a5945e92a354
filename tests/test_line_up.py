"""How late actions take effect, told by windows that are compared one by one."""

import numpy as np

from simtune.fit.line_up import clearly_best


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
