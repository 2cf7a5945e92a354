"""Random numbers from one seed: each purpose has a stream of its own, independent of all others.

Were two to share one, what is drawn first of one would tell what is drawn first of the other, such
as on which side of a start the truth is. So no other place makes a generator from a seed that a
user gives.
"""

from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """What random numbers are drawn for. From 1 on: numpy takes (seed, 0) for seed."""

    WRONG_START = 1
    REALITY_GAP = 2
    FIRST_FILM = 3  # of a pseudo-real world
    POLICY_FILM = 4
    ROBOT = 5
    KEYPOINTS = 6
    TRAINING = 7
    SCORE = 8  # of a policy
    SEARCHED_WORLDS = 9
    PAPER_SEARCH = 10
    PACE = 11
    DESCENTS = 12
    WHOLE_EPISODES = 13
    CAMERA_CHANGES = 14
    READING_CHANGES = 15
    POSTERIOR = 16
    RECORD = 17
    CHECKED_EPISODES = 18
    NOMINAL_STATES = 19
    STARTS = 20
    LIBRARY = 21  # of pictures that films are compared with
    PLAYED_ACTIONS = 22
    CAMERA_POSE = 23
    START_SEARCH = 24


def stream(seed: int, purpose: Purpose, *numbers: int) -> np.random.Generator:
    """Those of a purpose; with `numbers` from 0 on, such as an episode's, of a part of it."""
    return np.random.default_rng((seed, purpose, *(number + 1 for number in numbers)))
