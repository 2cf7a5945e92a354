"""Where segments of episodes begin, if joints are read at different rows, and how sure that is."""

import numpy as np
import pytest
from test_fit import SPACE, simulator  # noqa: F401
from test_joint_readings import sensor_of

from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.readings import Readings
from simtune.fit.readings.segments import Segments, may_begin
from simtune.observation import ObservationModel


def readings_of(*every: int, num_steps: int = 60, first: int = 0) -> Readings:
    """One episode, of joints that are read at every so many rows."""
    values = np.full((1, num_steps + 1, len(every)), np.nan)
    for joint, rows in enumerate(every):
        values[0, (first if joint else 0) :: rows, joint] = np.sin(
            0.2 * np.arange(first if joint else 0, num_steps + 1, rows)
        )
    return Readings(np.zeros((1, num_steps, 1)), values)


def test_segments_begin_where_all_joints_are_read():
    rows = np.flatnonzero(may_begin(readings_of(1, 5))[0])
    assert rows.tolist() == list(range(0, 61, 5))
    never = readings_of(1, 5)
    never.values[..., 1] = np.nan  # in the whole episode
    assert may_begin(never).all()
    rare = np.flatnonzero(may_begin(readings_of(1, 40))[0]).tolist()
    assert rare == [0, *range(9, 32), 40, *range(49, 61)]  # none near by: those with any


def test_segments_follow_each_other_as_soon_as_there_is_a_reading():
    dense = Segments.evenly(readings_of(1, 1), 12)
    assert dense.begin.tolist() == [0, 12, 24, 36, 48]
    slow = Segments.evenly(readings_of(5, 5), 12)
    assert slow.begin.tolist() == [0, 15, 30, 45]  # not only at common multiples
    assert Segments.evenly(readings_of(1, 5)).begin.tolist() == [0]
    two = Readings(np.zeros((2, 60, 1)), np.concatenate([readings_of(1).values] * 2))
    assert Segments.evenly(two, 20, at_most=3).episode.tolist() == [0, 0, 1]


@pytest.mark.parametrize(("first", "is_sure"), [(0, True), (3, False)])
def test_where_a_joint_is_not_read_its_first_state_is_less_sure(simulator, first, is_sure):  # noqa: F811
    sensor = sensor_of(joints=("slider", "hinge_1"))
    seen = ObservationModel.of_simulator((sensor,))
    loop = set_up_loop(simulator, seen, SPACE.nominal)
    readings = readings_of(10, 10, first=first)
    stretches = loop.cut(
        readings,
        SPACE.to_unit(SPACE.nominal),
        np.zeros(2),
        Segments(np.zeros(2, int), np.array([0, 20]), np.full(2, 40)),
    )
    std = loop.measured.start_std(np.full(2, 1e-3), stretches)
    assert std[0] == pytest.approx(1e-3)
    assert (std[1] == pytest.approx(1e-3)) == is_sure
    assert std[1] < 2.0
