"""Trajectories, and actions that come late."""

import numpy as np

from simtune.trajectory import Trajectory, delayed


def test_late_actions_begin_with_the_first_one():
    actions = np.array([[[5.0], [6.0], [7.0]]])
    assert delayed(actions, 2).ravel().tolist() == [5, 5, 5]
    assert delayed(actions, 1).ravel().tolist() == [5, 5, 6]
    assert delayed(actions, 0).ravel().tolist() == [5, 6, 7]
    assert delayed(np.zeros((2, 3, 0)), 1).shape == (2, 3, 0)


def test_the_first_steps_of_a_trajectory():
    frames = np.zeros((6, 2, 2, 3), np.uint8)
    whole = Trajectory(frames, np.arange(5.0)[:, None], 0.1)
    part = whole.first(2)
    assert (len(part), len(part.frames), part.step_s) == (2, 3, 0.1)
    assert part.actions.ravel().tolist() == [0, 1]
    assert len(whole.first(9)) == 5
