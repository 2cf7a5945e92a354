"""examples/servos: every kind that makes a servo, checked, and found again from its encoders."""

import json
from pathlib import Path

import numpy as np
import pytest

from simtune.before_after.readings import Tuned, replay
from simtune.budget import Budget
from simtune.checking import check
from simtune.config import CheckConfig, TuneConfig
from simtune.experiment.experiment import build_experiment

EXAMPLE = Path(__file__).parents[2] / "examples" / "servos"
ALMOST = 0.005  # rad: a share of an angle near zero means little


@pytest.mark.slow
def test_check_has_a_line_of_each_kind():
    report = check(CheckConfig(task=str(EXAMPLE / "tune.toml"), episodes=3))
    assert sorted(report["parameters"]) == sorted(json.loads((EXAMPLE / "truth.json").read_text()))
    assert {its["verdict"] for its in report["parameters"].values()} == {"shows clearly"}


@pytest.mark.slow
def test_each_kind_is_found_again(tmp_path: Path):
    config = TuneConfig(
        task=str(EXAMPLE / "tune.toml"), out=tmp_path, real_episodes=4, seed=0,
        real_parameters=EXAMPLE / "truth.json",
    )  # fmt: skip
    experiment = build_experiment(config)
    found = experiment.search.run_round(experiment.recordings, Budget()).estimate
    truth = experiment.space.from_dict(json.loads((EXAMPLE / "truth.json").read_text()))
    assert np.all(np.abs(found.mean - truth) < np.maximum(0.05 * truth, ALMOST))
    assert ((found.low <= truth) & (truth <= found.high)).sum() >= 9
    assert found.verdict.count("identified") >= 9


@pytest.mark.thorough
def test_a_replay_of_the_truth_leaves_nothing_but_noise(tmp_path: Path):
    """Also of episodes that begin with a jerk, faster than readings tell a velocity.

    Such as the fifth: its elbow is commanded 1 rad away at once.
    """
    truth = EXAMPLE / "truth.json"
    config = TuneConfig(
        task=str(EXAMPLE / "tune.toml"), out=tmp_path, real_episodes=6, real_parameters=truth
    )
    its = build_experiment(config)
    context, values = its.context, its.space.from_dict(json.loads(truth.read_text()))
    played = replay(
        context.simulator, context.observation, its.recordings, context.start, Tuned(values, {})
    )
    assert [score["rms"] for score in played.scores().values()] == pytest.approx(
        [0.001] * 3, rel=0.1
    )
