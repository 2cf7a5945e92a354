"""Runs of benchmarks/whole_runs.py and precision.py: their truths, processes, cores and lines."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from run_lines import SPACE, a_line, whole_run

from simtune.errors import InputError
from simtune.tasks import TASKS, load_task

ROOT = Path(__file__).parents[2]
CORE = min(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0  # one that may run


@pytest.fixture(autouse=True)
def _as_a_script_finds_them(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


@pytest.mark.parametrize("task", TASKS)
def test_truths_of_runs_are_reproducible_and_spread_as_asked(task):
    from whole.truths import draw

    space = load_task(task).parameters
    drawn = [draw(task, space, seed) for seed in range(60)]
    assert drawn[3] == draw(task, space, 3)
    values = np.array([space.from_dict(truth) for truth in drawn])  # raises out of bounds
    assert len(np.unique(values, axis=0)) == 60
    for parameter, of_it in zip(space, values.T, strict=True):
        spread = {"rope_length": 1.25}.get(parameter.name, 2.0)
        low, high = parameter.nominal / spread, parameter.nominal * spread
        if parameter.name == "lighting":
            low, high = 0.2, 0.6
        elif parameter.is_colour:
            low, high = 0.25, 1.0
        margin = 0.15 * (high - low)
        assert low <= of_it.min() < low + margin
        assert high - margin < of_it.max() <= high


def test_dynamics_are_as_often_below_nominal_as_above():
    from whole.truths import draw

    masses = [draw("cartpole", SPACE, seed)["pole_mass"] for seed in range(400)]
    assert np.mean(np.array(masses) < 0.1) == pytest.approx(0.5, abs=0.08)  # 3 standard errors


def test_walker_links_has_a_truth_of_each_mass():
    from whole.truths import draw
    from whole.variants import load

    truth = draw("walker_links", load("walker_links").parameters, 0)
    masses = [truth[name] for name in ("torso_mass", "thighs_mass", "legs_mass")]
    assert len(set(masses)) == 3
    assert "mass" not in truth


def test_the_command_is_the_one_that_a_user_types():
    run = whole_run(gap=True)
    command = run.command(Path("w.json"), Path("out"))
    assert command[0] == str(Path(sys.executable).with_name("simtune"))
    assert " ".join(command[1:]) == (
        "tune cartpole --real-parameters w.json --real-episodes 5 --budget-minutes 6.0 --seed 3 "
        "--out out --real-gap"
    )
    precise = whole_run(precision=2.0).command(Path("w.json"), Path("out"))
    assert precise[-2:] == ["--precision", "2.0"]
    variant = whole_run(task="walker_links").command(Path("w.json"), Path("out"))
    assert variant[1:5] == ["-m", "whole.variants", "tune", "walker_links"]


def test_a_run_has_a_line_only_if_its_settings_are_the_same(tmp_path):
    from whole.lines import Lines

    known, run = Lines(tmp_path / "lines"), whole_run()
    assert not known.has(run)
    known.append("cartpole", a_line(run))
    assert known.has(run)
    assert known.of_run(run) == [a_line(run)]
    others = {"seed": 4, "cores": 2, "minutes": 5.0, "episodes": 4, "gap": True, "precision": 1.0}
    assert not any(known.has(whole_run(**{name: value})) for name, value in others.items())


def test_half_a_line_of_a_crash_is_dropped_before_the_next(tmp_path):
    from whole.lines import Lines

    known = Lines(tmp_path)
    known.append("cartpole", a_line())
    path = tmp_path / "cartpole.jsonl"
    path.write_text(path.read_text() + path.read_text()[:40])
    second = whole_run(seed=4)
    assert not known.has(second)
    known.append("cartpole", a_line(second))
    assert [line["seed"] for line in known.of("cartpole")] == [3, 4]
    assert len(path.read_text().splitlines()) == 2


@pytest.fixture
def measurement(tmp_path, monkeypatch):
    from whole.lines import Lines, scored
    from whole.measure import Measurement

    if hasattr(os, "sched_getaffinity"):
        monkeypatch.setattr(os, "sched_getaffinity", lambda process: {CORE})
    known = Lines(tmp_path / "lines")
    return Measurement(
        known=known, out=tmp_path / "out", score=lambda run, ended: scored(ended, SPACE)
    )


@pytest.fixture
def runs_are(monkeypatch):
    """Makes runs a few lines of Python, which are given WORLD.json and OUT."""
    from whole.run import WholeRun

    def choose(program: str) -> None:
        def command(run, world: Path, out: Path) -> list[str]:
            return [sys.executable, "-c", program, str(world), str(out)]

        monkeypatch.setattr(WholeRun, "command", command)

    return choose


def lines_of(measurement) -> list[dict]:
    return measurement.known.of("cartpole")


WRITES_A_RESULT = """
import json, os, sys
world, out = json.load(open(sys.argv[1])), sys.argv[2]
os.makedirs(out)
print('{"round": 1}', file=open(out + "/metrics.jsonl", "w"))
entry = {"verdict": "weak", "percent_error": 0.0}
found = {n: entry | {"mean": v, "low": v - .01, "high": v, "real": v} for n, v in world.items()}
cores = [str(sorted(os.sched_getaffinity(0)))]
result = {"parameters": found, "warnings": cores, "percent_error": 0.0}
json.dump(result, open(out + "/result.json", "w"))
"""


@pytest.mark.thorough
def test_runs_with_a_line_are_not_run_again_and_folders_are_removed(measurement, runs_are):
    runs_are(WRITES_A_RESULT)
    runs = [whole_run(seed=seed) for seed in range(3)]
    measurement.carry_out(runs[:2], jobs=2)
    first = lines_of(measurement)
    assert sorted(line["seed"] for line in first) == [0, 1]
    assert all(all(line["holds"].values()) for line in first)
    assert {line["rounds"] for line in first} == {1}
    runs_are("raise SystemExit('should not run')")
    measurement.carry_out(runs, jobs=2)
    assert lines_of(measurement)[:2] == first
    assert lines_of(measurement)[2]["failed"] == "exit status 1: should not run"
    measurement.carry_out(runs, jobs=2)
    assert len(lines_of(measurement)) == 3, "a failed run is not tried again"
    assert list(measurement.out.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be chosen here")
def test_a_run_stays_on_its_own_core(measurement, runs_are):
    runs_are(WRITES_A_RESULT)
    measurement.carry_out([whole_run()], jobs=1)
    assert lines_of(measurement)[0]["warnings"] == [f"[{CORE}]"]


def test_a_run_that_is_stopped_leaves_no_line(measurement, runs_are):
    runs_are("import os, signal; os.kill(os.getpid(), signal.SIGTERM)")
    measurement.carry_out([whole_run()], jobs=1)
    assert lines_of(measurement) == []
    assert list(measurement.out.iterdir()) == []


def test_a_run_that_is_killed_for_its_memory_is_a_failure(measurement, runs_are):
    runs_are("import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    measurement.carry_out([whole_run()], jobs=1)
    assert lines_of(measurement)[0]["failed"] == f"exit status -{signal.SIGKILL:d}: it said nothing"


def test_a_run_ends_when_the_benchmark_is_stopped(measurement, runs_are, monkeypatch):
    from whole.run import Stopped, carry_out

    runs_are("import time; time.sleep(60)")
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: None, raising=False)  # this thread's
    stop = threading.Event()
    threading.Timer(0.3, stop.set).start()
    with pytest.raises(Stopped):
        carry_out(whole_run(), measurement.out / "a", [CORE], stop)
    assert not (measurement.out / "a").exists()


def test_a_run_that_needs_more_cores_than_there_are_is_refused(measurement):
    with pytest.raises(SystemExit, match="2 cores, but there are 1"):
        measurement.carry_out([whole_run(cores=2)], jobs=1)


def test_runs_never_share_a_core():
    from whole.parallel import carry_out_all

    used, done, lock = set(), [], threading.Lock()

    def carry_out(run, cores, stop):
        with lock:
            assert not used & set(cores)
            assert len(cores) == run.cores
            used.update(cores)
        time.sleep(0.01)
        with lock:
            used.difference_update(cores)
            done.append(run.seed)

    runs = [whole_run(seed=seed, cores=1 + seed % 2) for seed in range(12)]
    carry_out_all(runs, 3, [4, 5, 6], carry_out)
    assert sorted(done) == list(range(12))


def test_runs_go_side_by_side_on_free_cores():
    from whole.parallel import carry_out_all

    both = threading.Barrier(2, timeout=60)  # which breaks if one waits for the other's end
    runs = [whole_run(seed=seed) for seed in range(2)]
    carry_out_all(runs, 2, [4, 5], lambda run, cores, stop: both.wait() and None)
    assert not both.broken


def test_an_error_ends_all_runs():
    from whole.parallel import carry_out_all

    begun = []

    def carry_out(run, cores, stop):
        begun.append(run.seed)
        if run.seed == 0:
            raise InputError("no")
        stop.wait(60)

    with pytest.raises(InputError, match="no"):
        carry_out_all([whole_run(seed=seed) for seed in range(5)], 1, [0], carry_out)
    assert len(begun) <= 2


@pytest.mark.parametrize("script", ["whole_runs", "precision"])
@pytest.mark.slow
def test_a_benchmark_of_whole_runs_ends_with_its_figures(script):
    command = [sys.executable, str(ROOT / "benchmarks" / f"{script}.py"), "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["benchmark"] == script
    assert figures["failed"] == []
    (task,) = figures["tasks"]
    assert task.get("runs", task.get("worlds")) == 1
