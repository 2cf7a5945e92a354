"""Warnings of recorded steps that are not used, and what would use more of them."""

from simtune.recordings.unused_steps import of_lengths, of_unfilmed

NAMES = [f"episode {number}" for number in range(10)]


def test_episodes_of_one_length_are_used_whole():
    assert of_lengths([30], NAMES[:1]) == of_lengths([30, 30, 30], NAMES[:3]) == []
    assert of_unfilmed({}) == []


def test_the_shortest_episode_is_named_and_what_it_costs():
    (said,) = of_lengths([90, 20, 80], NAMES[:3])
    assert said == (
        "episodes last 20 to 90 steps: all are cut to the shortest, episode 1, and 130 of 190 "
        "steps are not used; without it (--leave-out 1), 100 more would be used"
    )


def test_several_short_ones_are_left_out_together():
    lengths = [100, 21, 100, 22, 100, 100, 23, 100]
    (said,) = of_lengths(lengths, [f"swing{i}" for i in range(8)])
    assert (
        "without the 3 shortest (--leave-out swing1,swing3,swing6), 332 more would be used" in said
    )


def test_what_is_left_out_already_stays_so():
    (said,) = of_lengths([90, 20, 80], NAMES[:3], left_out=["episode 7"])
    assert "without it (--leave-out 7,1), 100 more would be used" in said


def test_no_advice_where_it_would_use_less():
    (said,) = of_lengths([90, 71, 77, 81, 88, 70, 81, 63, 59, 80], NAMES)
    assert "the shortest, episode 8, and 170 of 760 steps are not used" in said
    assert said.endswith("; without it, no more would be used")


def test_without_names_the_episode_is_counted():
    (said,) = of_lengths([90, 20, 80], [])
    assert "cut to the shortest, episode 1, counted from 0, and 130 of 190 steps" in said
    assert said.endswith("without it, 100 more would be used")


def test_rows_without_frames_are_one_line():
    assert of_unfilmed({"episode 2": 1}) == [
        "episode 2: its video has no frame for the last row: left out"
    ]
    (said,) = of_unfilmed({"episode 2": 1, "episode 4": 2, "episode 5": 1})
    assert said == (
        "episode 4: its video has no frame for the last 2 rows: left out, and so are those of "
        "2 other episodes"
    )
