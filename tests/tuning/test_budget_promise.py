"""--budget-minutes is a promise: never over by more than a tenth and ten seconds, anywhere."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_arm import write_arm
from slow_machine import SlowMachine

from simtune.budget import Budget
from simtune.config import TuneConfig
from simtune.errors import InputError
from simtune.experiment.experiment import build_experiment
from simtune.experiment.settings import Settings
from simtune.fit import FitConfig, Refits
from simtune.tuning.fitting import Fitting
from simtune.tuning.readings.estimate import search_of
from simtune.tuning.readings.first import ReadingsFirst, seconds_for
from simtune.tuning_run import tune

# Of a round of `simtune tune` it takes a fifth for networks and most for fits, on two cores.
MACHINE = SlowMachine(step_s=1e-3, frame_s=4e-3, detect_s=6e-3, update_s=0.3)


@pytest.fixture
def settings(tiny, quick) -> Settings:
    """Rounds as large as a test can bear, and whole fits."""
    search = replace(
        tiny,
        num_worlds=192,
        held_out_worlds=128,
        num_rounds=4,
        detector_updates=(60, 100),
        posterior_updates=30,
        state_updates=30,
        least_updates=10,
        planned_refits=4,
        most_refits=8,
        fit=FitConfig(num_particles=96),
    )
    return replace(quick, search=search)


def config_of(out: Path, minutes: float = 1.0) -> TuneConfig:
    return TuneConfig(
        task="cartpole", out=out, real_episodes=3, image_size=32, budget_minutes=minutes
    )


def needed_s(out: Path, settings: Settings, machine: SlowMachine) -> tuple[float, float]:
    """Of the smallest round and of a whole one, with all that comes before."""
    machine = machine.slower(1)  # with a clock of its own
    with pytest.MonkeyPatch.context() as patch:
        machine.take_over(patch)
        experiment = build_experiment(config_of(out), settings=settings)
        least_s, whole_s, *_ = experiment.search.measure_time(experiment.recordings)
    return machine.now_s + least_s, machine.now_s + whole_s


def run_s(out: Path, settings: Settings, machine: SlowMachine, seconds: float) -> float:
    """How long a run takes by the machine's clock."""
    with pytest.MonkeyPatch.context() as patch:
        machine.take_over(patch)
        tune(config_of(out, seconds / 60), settings=settings)
    return machine.now_s


@pytest.fixture
def refitted(monkeypatch) -> list[Refits]:
    """What each round's refits showed."""
    made, run = [], Fitting.refit

    def watched(*given) -> Refits:
        made.append(run(*given))
        return made[-1]

    monkeypatch.setattr(Fitting, "refit", watched)
    return made


def ends_in_time(out: Path, settings: Settings, factor: float, budget: str) -> None:
    machine = MACHINE.slower(factor)
    least_s, whole_s = needed_s(out / "asked", settings, machine)
    seconds = {
        "least": least_s + 6,  # and the report
        "twice the least": 2 * least_s,
        "a whole round": whole_s,
        "several rounds": 4 * whole_s,
    }[budget]
    took_s = run_s(out / "run", settings, machine, seconds)
    assert took_s <= 1.1 * seconds + 10
    assert took_s > 0.5 * seconds, "it is made use of"


@pytest.mark.thorough
def test_a_run_ends_in_time_on_a_slow_machine_that_has_the_least_time(tmp_path, settings):
    ends_in_time(tmp_path, settings, 20, "least")


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1, 5, 20])
@pytest.mark.parametrize("budget", ["least", "twice the least", "a whole round", "several rounds"])
def test_a_run_ends_in_time_however_slow_the_machine_is(tmp_path, settings, factor, budget):
    ends_in_time(tmp_path, settings, factor, budget)


@pytest.mark.slow
def test_intervals_are_three_times_as_wide_where_there_is_no_time_for_refits(
    tmp_path, settings, refitted
):
    machine = MACHINE.slower(20)
    least_s, _ = needed_s(tmp_path / "asked", settings, machine)
    run_s(tmp_path / "late", settings, machine, 1.1 * least_s)
    (late,) = refitted
    assert len(late.errors) == 0
    np.testing.assert_array_equal(late.inflation(), 3.0)
    assert (tmp_path / "late" / "report.html").is_file()


@pytest.mark.slow
def test_a_round_that_has_its_time_has_its_refits(tmp_path, settings, refitted):
    _, whole_s = needed_s(tmp_path / "asked", settings, MACHINE)
    run_s(tmp_path / "run", settings, MACHINE.slower(1), whole_s)
    assert all(len(refits.misfits) >= 2 for refits in refitted)


@pytest.mark.parametrize("more", [1.0, 2.5])
def test_readings_alone_of_a_slow_model_end_in_time(tmp_path: Path, more):
    """A step of the whole arm takes 50 ms, one derivative of the episodes minutes."""
    arm, machine = write_arm(tmp_path), replace(MACHINE, step_s=0.05)

    def run(minutes: float) -> None:
        config = TuneConfig(
            task=str(arm), out=tmp_path / "run", real_episodes=2, budget_minutes=minutes
        )
        with pytest.MonkeyPatch.context() as patch:
            machine.now_s = 0.0
            machine.take_over(patch)
            tune(config)

    with pytest.raises(InputError, match=r"is too short: .* Simulating takes 100%") as refused:
        run(1.0)
    minutes = more * float(re.findall(r"--budget-minutes ([\d.]+) or more", str(refused.value))[0])
    run(minutes)
    assert machine.now_s <= 1.1 * 60 * minutes + 10
    assert machine.now_s > 0.5 * 60 * minutes, "it is made use of"


def test_readings_get_what_a_round_of_videos_does_not_need():
    """Half of the time at most, if they tell all of a robot; and so where no round can be made."""
    shares = {100.0: 0.5, 230.0: 0.425, 260.0: 0.35, 261.0: 0.5, 900.0: 0.5}
    for round_s, share in shares.items():
        assert seconds_for(400.0, round_s, True) == pytest.approx(share * 400)
    assert seconds_for(400.0, 320.0, False) == pytest.approx(80)
    assert seconds_for(400.0, 341.0, False) == pytest.approx(0.35 * 400)
    assert seconds_for(math.inf, 100.0, True) == math.inf


def test_readings_that_take_longer_than_their_time_are_left_to_windows(tmp_path: Path):
    arm, machine = write_arm(tmp_path), replace(MACHINE, step_s=0.05)
    config = TuneConfig(task=str(arm), out=tmp_path / "run", real_episodes=4, budget_minutes=8)
    with pytest.MonkeyPatch.context() as patch:
        machine.take_over(patch)
        experiment = build_experiment(config)
        began_s = machine.now_s
        real, first = experiment.recordings, ReadingsFirst(experiment.context)
        search, _ = search_of(experiment.context, real) or (None, None)
        assert search is not None
        first._fit(search, real, Budget(20.0))
        assert machine.now_s - began_s < 20
        (said,) = first.warnings
        assert " s were left for it" in said
        assert "--observe joints" in said
        assert first._estimate is None
        first._fit(search, real, Budget(2000.0))
        assert first._estimate is not None
