"""Readings in degrees, declared as rad, are said to be such where no world endures them."""

from importlib import import_module
from types import SimpleNamespace
from typing import cast

import mujoco
import numpy as np
import pytest

from simtune.checking import expected_precision
from simtune.checking.mistakes.degrees import like_degrees
from simtune.errors import InputError
from simtune.observation import JointSensor, ObservationModel
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory

MODEL = mujoco.MjModel.from_xml_string(
    """
    <mujoco><compiler angle="radian"/><worldbody><body>
      <joint name="wheel"/><geom size=".1"/>
      <body><joint name="elbow" range="-1 2.5"/><geom size=".1"/></body>
    </body></worldbody></mujoco>
    """
)


@pytest.mark.parametrize(
    ("wheel", "elbow", "said"),
    [
        ([-40, 72.43], [0, 107.9], "wheel 72.43, elbow 107.9"),
        ([-0.7, 1.3], [0, 107.9], "elbow 107.9"),
        ([0, 3000], [0, 2.6], None),  # a wheel that turned for long
        ([-0.7, 1.3], [0, 7.4], None),  # an encoder's zero a turn away
        ([np.nan, 6.5], [0, 500], None),  # degrees would be beyond the range as well
    ],
)
def test_readings_far_beyond_a_hinge_that_fit_as_degrees_are_asked_about(wheel, elbow, said):
    read = np.stack([np.linspace(*wheel, 20), np.linspace(*elbow, 20)], -1)[None]
    names, one = ("wheel", "elbow"), np.ones(2)
    sensor = JointSensor(
        name="encoders", columns=names, joints=names, places=np.arange(2), factor=one, shift=0 * one
    )
    found = like_degrees(MODEL, [sensor], read)
    if said is None:
        assert found == []
    else:
        (sentence,) = found
        assert f"the largest readings in rad are {said}, far beyond" in sentence
        assert 'unit = "deg" in [[sensors]]' in sentence


def test_they_are_asked_about_where_every_episode_diverges(monkeypatch):
    """By `check`, which ends there, and by `tune`, which warns and goes on."""

    def diverge(*given):
        raise RuntimeError("every episode diverged")

    check = import_module("simtune.checking.check")  # the package has a function of that name
    names, one = ("elbow",), np.ones(1)
    sensor = JointSensor(
        name="arm", columns=names, joints=names, places=np.arange(1), factor=one, shift=0 * one
    )
    simulator = object.__new__(Simulator)
    simulator.model = MODEL
    read = SimpleNamespace(
        readings=SimpleNamespace(values=np.linspace(0, 107.9, 20).reshape(1, 20, 1)),
        **{kind: [] for kind in ("warnings", "misread", "beyond_ranges")},
    )
    seen, actions = cast(ObservationModel, SimpleNamespace(sensors=[sensor])), np.zeros((19, 1))
    for module in (check, expected_precision):
        monkeypatch.setattr(module, "reading_changes", diverge)
    monkeypatch.setattr(expected_precision, "look_at_servos", lambda *_: read)
    given = check.Given(simulator, actions[None], {"warnings": []}, read, is_far=True)
    with pytest.raises(InputError, match="every episode diverged; the largest readings in rad are"):
        check._replayed(given, seen, 0, lambda *_: None)
    real = [Trajectory(np.zeros((20, 0, 0, 3), np.uint8), actions, 0.05)]
    found = expected_precision.expected_precision(simulator, seen, real, 0)
    assert any("are they in degrees?" in warning for warning in found.warnings)
