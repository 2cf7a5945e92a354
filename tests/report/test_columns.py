"""Numbers as text: the same decimals for an estimate and its interval."""

import logging
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from simtune.columns import significant, two_digits, within
from simtune.experiment import outcome
from simtune.experiment.run import Run
from simtune.report.words import as_precise, interval


@pytest.mark.parametrize(
    ("low", "value", "high", "shown"),
    [
        (0.6999, 0.70032, 0.7008, ("0.69990", "0.70032", "0.70080")),
        (0.0642, 0.0651, 0.0662, ("0.0642", "0.0651", "0.0662")),
        (0.99391, 0.998, 1.0, ("0.9939", "0.9980", "1.0000")),
        (0.999841, 0.9999, 1.0, ("0.999841", "0.999900", "1.000000")),
        (856.0, 893.0, 932.0, ("856", "893", "932")),
        (11_000.0, 12_345.6, 13_000.0, ("11,000", "12,346", "13,000")),
        (1.98e-5, 2e-5, 2.03e-5, ("0.00001980", "0.00002000", "0.00002030")),
        (2e-7, 3e-7, 4e-7, ("2.0e-07", "3.0e-07", "4.0e-07")),
        (
            1_234_567.0,
            1_234_569.0,
            1_234_571.0,
            ("1.2345670e+06", "1.2345690e+06", "1.2345710e+06"),
        ),
        (0.011, 0.2, 3.5, ("0.01", "0.20", "3.50")),  # the low end is not 0.0
        (1e-4, 0.2, 3.5, ("0.000", "0.200", "3.500")),
        (-0.5, -0.001, 0.25, ("-0.50", "0.00", "0.25")),
        (5.0, 5.0, 5.0, ("5.00", "5.00", "5.00")),
    ],
)
def test_an_estimate_and_its_interval_have_the_same_decimals(low, value, high, shown):
    assert tuple(within(v, low, high) for v in (low, value, high)) == shown
    facts = {"low": low, "high": high}
    assert interval(facts) == f"[{shown[0]}, {shown[2]}]"
    assert as_precise(value, facts) == shown[1]


def test_without_an_interval_a_number_has_three_digits():
    assert as_precise(0.064918, {"low": None, "high": 1.0}) == "0.0649"
    assert as_precise(None, {"low": 0.0, "high": 1.0}) == "–"
    assert interval({"low": None, "high": 1.0}) == ""


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0, "0"), (4.54e-4, "0.000454"), (2.1e-5, "0.0000210"), (2.1e-6, "2.10e-06"), (1230, "1,230")],
)
def test_sizes_from_a_hundred_thousandth_on_need_no_exponent(value, shown):
    assert significant(value) == shown


def test_two_digits_of_a_number_and_all_of_whole_ones():
    shown = [two_digits(value) for value in (0.0456, 3.21, 140.2, 4.5e-5, 3, 4.5e-6, 0)]
    assert shown == ["0.046", "3.2", "140", "0.000045", "3", "4.5e-06", "0"]


def test_a_first_answer_whose_precision_is_not_known_has_three_digits(monkeypatch, caplog):
    monkeypatch.setattr(outcome, "scalars", lambda *_: {})
    space = [SimpleNamespace(name="mass"), SimpleNamespace(name="gain")]
    experiment = SimpleNamespace(space=space, search=SimpleNamespace(distribution=None))
    run: Any = SimpleNamespace(experiment=experiment, log=lambda *_: None)
    run.experiment.recordings = []
    early: Any = SimpleNamespace(mean=np.array([0.064918, 0.00045417]))
    with caplog.at_level(logging.INFO, "simtune"):
        Run.log_early(run, early)
    assert caplog.messages[-1].endswith("mass 0.0649, gain 0.000454")
