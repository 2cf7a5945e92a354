"""`tune` end to end: what it writes, that it resumes, and that it never looks at the truth."""

import dataclasses
import json
import math
import shutil
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from other_keypoints import find_others
from servo import cartpole_with_servo

from simtune import tuning_run
from simtune.before_after import start_search, videos
from simtune.before_after.start_search import StartSearchConfig
from simtune.config import RealConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment import enough_time, outcome, recording_checks
from simtune.experiment.experiment import build_experiment
from simtune.experiment.search_settings import choose_search_settings, make_search
from simtune.observation import ObservationModel
from simtune.parameters import Parameter, ParameterSpace
from simtune.parameters.values_file import read_parameters
from simtune.real.choose import choose_real
from simtune.real.pseudo import PseudoReal
from simtune.real.truth import Truth
from simtune.recordings import decode, write_dataset
from simtune.run.checkpoint import load_state, newest
from simtune.run.files import read_json, read_jsonl
from simtune.simulation import JointActions
from simtune.tasks import load_task
from simtune.trajectory import Trajectory, seen_late
from simtune.tuning.estimate import Estimate
from simtune.tuning.joint import NUM_DRAWS
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import Event, Round, TimeNeeded
from simtune.tuning_run import tune

TASK = load_task("cartpole")
SPACE = TASK.parameters
NO_HURRY = math.inf  # minutes: the updates end the training, not the time
TRUTH = {"pole_mass": 0.15, "body_r": 0.4, "ground_g": 0.8}


def config_of(out: Path, **changes) -> TuneConfig:
    config = TuneConfig(
        task="cartpole", out=out, real_episodes=2, image_size=32, budget_minutes=NO_HURRY, seed=3
    )
    return dataclasses.replace(config, **changes)


@pytest.fixture
def no_check(monkeypatch):
    """Runs do not say what check would, as `finished` and `one_round` do: it takes a second."""
    monkeypatch.setattr(recording_checks, "_CHECK_SHARE", 0.0)


@pytest.fixture(scope="module")
def truth_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("truth") / "truth.json"
    path.write_text(json.dumps(TRUTH))
    return path


@contextmanager
def eventful_rounds():
    """Every round of a search has an event."""

    def run_eventful_round(*given) -> Round:
        event = Event("widened", "pole_mass", 0.1, 0.2, "the edge")
        return run_round(*given)._replace(events=[event])

    run_round = PosteriorSearch.run_round
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PosteriorSearch, "run_round", run_eventful_round)
        yield


class FinishedRun(NamedTuple):
    out: Path
    returned: dict
    reported: list[tuple[str, float]]


@pytest.fixture(scope="module")
def finished(tmp_path_factory, truth_file, quickly) -> FinishedRun:
    """A run of two eventful rounds in the world of `truth_file`."""
    out = tmp_path_factory.mktemp("finished") / "runs" / "a"
    reported: list[tuple[str, float]] = []
    config = config_of(out, real_parameters=truth_file)
    with quickly() as quick, eventful_rounds():
        returned = tune(config, lambda *words: reported.append(words), quick)
    return FinishedRun(out, returned, reported)


@pytest.fixture(scope="module")
def one_round(tmp_path_factory, quickly) -> Path:
    """The folder of a run whose time was over after its first round."""
    out = tmp_path_factory.mktemp("one_round") / "run"
    with quickly() as quick:
        tune(config_of(out, budget_minutes=1e-6), settings=quick)
    return out


# --- what is written ----------------------------------------------------------------------


def keeps_the_contract(entry: dict, parameter: Parameter) -> None:
    """What result.json says of one parameter, started at ×2 or ×½ of TRUTH."""
    real = TRUTH.get(parameter.name, parameter.nominal)
    numbers = {"nominal", "initial", "mean", "low", "high", "real", "percent_error"}
    assert set(entry) == numbers | {"unit", "verdict", "interval_share"}
    assert all(type(entry[key]) is float for key in numbers | {"interval_share"})
    assert (entry["unit"], entry["nominal"]) == (parameter.unit, parameter.nominal)
    assert entry["real"] == pytest.approx(real)
    doubled, halved = min(2 * real, parameter.high), real / 2
    assert entry["initial"] in (pytest.approx(doubled), pytest.approx(halved))
    assert parameter.low <= entry["low"] <= entry["mean"] <= entry["high"] <= parameter.high
    assert entry["verdict"] in ("identified", "weak", "not identifiable")
    expected = 100 * abs(entry["mean"] - real) / real
    assert entry["percent_error"] == pytest.approx(expected)


def rounds_of(run: Path) -> list[dict]:
    """Lines of metrics.jsonl, without early answers."""
    return [line for line in read_jsonl(run / "metrics.jsonl") if "round" in line]


def metrics_keep_the_contract(lines: list[dict], result: dict) -> None:
    """What metrics.jsonl says of two rounds, of which the last was judged by refits."""
    assert ["is_early" in line for line in lines] == [False, True, False]
    assert f"mean/{SPACE.names[0]}" in lines.pop(1)
    assert [line["round"] for line in lines] == [1, 2]
    assert list(lines[0]) == list(lines[1])
    assert list(lines[0])[:3] == ["step", "real_episodes", "wall_s"]
    for column in ("mean", "low", "high", "range_low", "range_high"):
        assert all(f"{column}/{name}" in lines[0] for name in SPACE.names)
    assert lines[0]["step"] < lines[1]["step"] == result["sim_steps"]
    assert lines[0]["wall_s"] < lines[1]["wall_s"]
    assert all(line["real_episodes"] == 2 for line in lines)
    assert lines[1]["mean/pole_mass"] == result["parameters"]["pole_mass"]["mean"]
    assert not any("percent_error" in key or "real/" in key for key in lines[0])


def tells_of_the_joint_posterior(out: Path, result: dict) -> None:
    with np.load(out / "posterior.npz") as file:
        names, draws, correlation = (file[key] for key in ("names", "draws", "correlation"))
    assert tuple(names) == SPACE.names
    assert draws.shape == (NUM_DRAWS, len(SPACE))
    np.testing.assert_array_equal(draws, SPACE.clip(draws))
    assert (np.ptp(draws, axis=0) > 0).all()
    told = result["covariance"]
    assert [c["name"] for c in told["coordinates"]] == list(SPACE.names)
    assert {c["scale"] for c in told["coordinates"]} == {"log", "linear"}
    matrix = np.array(told["matrix"])
    std = np.sqrt(np.diag(matrix))
    np.testing.assert_allclose(matrix, correlation * np.outer(std, std), atol=1e-12)
    appearance = SPACE.is_appearance
    assert (correlation[np.ix_(appearance, ~appearance)] == 0).all()
    assert correlation[0, 1] != 0 != correlation[2, 3]  # two that move, two colours
    medians = np.median(SPACE.to_unit(draws), 0)
    np.testing.assert_allclose(medians, told["mean"], atol=0.1)
    assert isinstance(result["combinations"], list)


def test_a_finished_run_has_the_files_and_fields_that_are_documented(finished):
    out, returned, reported = finished
    result = read_json(out / "result.json")
    assert result == json.loads(json.dumps(returned))
    metadata = {"task": "cartpole", "method": "autotune", "search": "posterior", "seed": 3}
    assert {key: result[key] for key in metadata} == metadata
    assert "command" not in result  # there is none where Python calls
    assert result["stopped"] == "all rounds are done"
    assert result["real_episodes"] == 2
    assert isinstance(result["sim_steps"], int)
    assert result["sim_steps"] >= 2 * 16 * 2 * 24  # rounds, worlds, episodes, steps
    assert isinstance(result["wall_s"], float)
    assert list(result["parameters"]) == list(SPACE.names)
    for parameter in SPACE:
        keeps_the_contract(result["parameters"][parameter.name], parameter)
    errors = [entry["percent_error"] for entry in result["parameters"].values()]
    assert result["percent_error"] == pytest.approx(np.mean(errors))

    lines = read_jsonl(out / "metrics.jsonl")
    metrics_keep_the_contract(lines, result)

    events = read_jsonl(out / "events.jsonl")
    assert [e["step"] for e in events] == [line["step"] for line in lines]
    expected = {"event": "widened", "parameter": "pole_mass", "low": 0.1, "high": 0.2}
    assert expected.items() <= events[0].items()

    curves = read_json(out / "curves.json")
    assert set(curves) == set(SPACE.names)
    for curve in curves.values():
        assert len(curve["candidates"]) == len(curve["prob_higher"]) > 50
        assert (np.diff(curve["prob_higher"]) <= 0).all()

    tells_of_the_joint_posterior(out, result)

    for name in ("real", "before", "after"):
        pictures = list(decode(out / "videos" / f"{name}.mp4"))
        assert len(pictures) == 25
    assert list((out / "tensorboard").glob("events.out.tfevents.*"))
    report = (out / "report.html").read_text()
    assert all(name in report for name in SPACE.names)
    assert "round 1:" in report  # the history of the estimates
    assert "round 2:" in report
    stored = read_json(out / "config.json")["config"]
    assert stored["task"] == "cartpole"
    assert stored["seed"] == 3
    assert "real" not in stored["parameters"]["pole_mass"]
    shares = [done for _, done in reported]
    assert shares[0] == 0
    assert shares[-1] == 1


def write_recordings(folder: Path, num: int, seed: int) -> list[Trajectory]:
    simulator = load_task("cartpole").simulator(image_size=64)
    truth = Truth(SPACE, SPACE.nominal)
    trajectories = truth.make_real(simulator, episode_steps=24, seed=seed).collect(num)
    names = {"action_names": ["slide"], "robot_type": "cartpole", "task": "balance"}
    write_dataset(folder, trajectories, **names)
    return trajectories


@pytest.mark.thorough
@pytest.mark.usefixtures("no_check")
def test_a_run_on_recordings_replays_them_and_refuses_changed_ones(tmp_path, quick, monkeypatch):
    trajectories = write_recordings(tmp_path / "dataset", num=3, seed=0)
    played = []

    def spy(search, real, *others) -> Round:
        played.append(real)
        return run_round(search, real, *others)

    run_round = PosteriorSearch.run_round
    monkeypatch.setattr(PosteriorSearch, "run_round", spy)
    config = config_of(
        tmp_path / "run", real=str(tmp_path / "dataset"), budget_minutes=1e-6, image_size=64
    )
    result = tune(config, settings=quick)
    assert len(played[0]) == result["real_episodes"] == 2
    for got, expected in zip(played[0], trajectories, strict=False):
        np.testing.assert_array_equal(got.actions, expected.actions)
        assert got.step_s == pytest.approx(TASK.step_s)
        assert np.abs(got.frames.astype(float) - expected.frames).mean() < 5  # video compression
    assert result["real"] == str(tmp_path / "dataset")
    assert "percent_error" not in result
    for parameter in SPACE:
        entry = result["parameters"][parameter.name]
        assert entry["initial"] == parameter.nominal
        assert not {"real", "percent_error"} & set(entry)
    assert result["recordings"]["steps"] == 2 * 24
    assert result["recordings"]["episodes_in_dataset"] == len(trajectories)
    assert (tmp_path / "run" / "report.html").is_file()

    shutil.rmtree(tmp_path / "dataset")
    write_recordings(tmp_path / "dataset", num=3, seed=1)
    with pytest.raises(InputError, match=r"a run with other recordings than \S+/dataset: give"):
        tune(config, settings=quick)
    assert json.loads((tmp_path / "run" / "result.json").read_text()) == result


# --- resuming -----------------------------------------------------------------------------


def without_time(lines: list[dict]) -> list[dict]:
    return [{k: v for k, v in line.items() if k != "wall_s"} for line in lines]


@pytest.mark.thorough
def test_an_interrupted_run_resumes_to_the_same_result(finished, tmp_path, truth_file, quick):
    straight = finished.returned

    def interrupt(doing: str, done: float) -> None:
        if doing.startswith("round 2"):
            raise KeyboardInterrupt

    config = config_of(out := tmp_path / "resumed", real_parameters=truth_file)
    with eventful_rounds():
        with pytest.raises(KeyboardInterrupt):
            tune(config, interrupt, quick)
        assert not (out / "result.json").exists()
        assert not (out / "posterior.npz").exists()
        assert len(rounds_of(out)) == 1
        resumed = tune(config, settings=quick)
    assert resumed["parameters"] == straight["parameters"]
    assert resumed["sim_steps"] == straight["sim_steps"]
    for name in ("metrics.jsonl", "events.jsonl"):
        lines = [read_jsonl(path / name) for path in (finished.out, out)]
        assert without_time(lines[0]) == without_time(lines[1])
    wall_s = [line["wall_s"] for line in rounds_of(out)]
    assert wall_s[0] < wall_s[1]

    # And once more, when all is done: the same result, without another round.
    again = tune(config, settings=quick)
    assert again["parameters"] == straight["parameters"]
    assert again["covariance"] == straight["covariance"]
    assert (out / "posterior.npz").read_bytes() == (finished.out / "posterior.npz").read_bytes()
    assert len(rounds_of(out)) == 2


@pytest.mark.thorough
def test_another_configuration_is_refused_in_the_same_folder(one_round, truth_file, quick):
    out = one_round
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    for changes, word in (
        ({"seed": 4}, "--seed 3, now 4"),
        ({"real_episodes": 1}, "--real-episodes 2, now 1"),
        ({"real_parameters": truth_file}, "--real-parameters|parameters"),
    ):
        with pytest.raises(InputError, match=word):
            tune(config_of(out, **changes), settings=quick)
    after = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    assert before == after


@pytest.mark.thorough
@pytest.mark.usefixtures("no_check")
def test_a_run_whose_time_is_over_ends_after_one_round_and_goes_on_with_more(
    one_round, tmp_path, quick, monkeypatch
):
    def interrupt_fitting(doing: str, done: float) -> None:
        if doing.endswith("fitting"):
            raise KeyboardInterrupt

    out = shutil.copytree(one_round, tmp_path / "run")
    first = read_json(out / "result.json")
    assert first["stopped"].startswith("the time is over")
    assert len(rounds_of(out)) == 1
    (Path(out) / "result.json").unlink()  # as where a run that went on was interrupted
    again = tune(config_of(out, budget_minutes=1e-6), settings=quick)
    assert len(rounds_of(out)) == 1
    assert again["parameters"] == first["parameters"]
    with monkeypatch.context() as patch:  # what is left is less than the last sitting's round took
        patch.setattr(tuning_run, "WORTHWHILE", 1e12)
        tune(config_of(out, budget_minutes=1e3), settings=quick)
    assert len(rounds_of(out)) == 1
    with pytest.raises(KeyboardInterrupt):
        tune(config_of(out), interrupt_fitting, quick)
    assert (
        read_json(out / "result.json")["parameters"] == first["parameters"]
    )  # until there is more
    tune(config_of(out), settings=quick)
    assert len(rounds_of(out)) == 2
    assert read_json(out / "result.json")["parameters"] != first["parameters"]


@pytest.mark.thorough
@pytest.mark.usefixtures("no_check")
def test_a_run_that_is_as_precise_as_asked_stops_and_says_so(tmp_path, quick):
    search = dataclasses.replace(quick.search, precision=1e9, num_rounds=4)
    settings = dataclasses.replace(quick, search=search)
    config = config_of(tmp_path / "run", real_episodes=1)
    result = tune(config, settings=settings)
    assert result["stopped"] == "every parameter is known to 1e+11 %"
    assert len(rounds_of(tmp_path / "run")) == 1
    again = tune(config, settings=settings)
    assert again["stopped"] == result["stopped"]
    assert len(rounds_of(tmp_path / "run")) == 1


def test_a_time_too_short_for_the_smallest_round_is_refused_with_one_that_is_not(
    tmp_path, quick, monkeypatch, caplog
):
    class Begun(Exception):
        pass

    def begin(*given):
        raise Begun

    def measure(search, real) -> TimeNeeded:
        now_s[0] += 12.0  # that measuring takes
        return TimeNeeded(100.0, 300.0, mostly="Simulating takes 90 % of that")

    now_s, built = [0.0], build_experiment(config_of(tmp_path / "run"), settings=quick)
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    monkeypatch.setattr(tuning_run, "build_experiment", lambda *_: built)
    monkeypatch.setattr(PosteriorSearch, "measure_time", measure)
    monkeypatch.setattr(PosteriorSearch, "run_round", begin)
    # Less than 12 s, 0.6 of the smallest round and 6 s for the report is refused; what is named
    # has two of the smallest.
    reason = (
        r"--budget-minutes 1\.1 is too short: .* 100 to 200 s .* 300 s; .* --budget-minutes "
        r"3\.7 or more\. Simulating takes 90 % of that"
    )
    with pytest.raises(InputError, match=reason):
        tune(config_of(tmp_path / "run", budget_minutes=1.1))
    assert not (tmp_path / "run").exists()  # or the next command would find a run there
    said = {1.4: "perhaps nothing can be called identified: 6 are enough", 3.7: "a shortened one"}
    for minutes in (1.4, 3.7, 5.4):
        caplog.clear()
        with pytest.raises(Begun), caplog.at_level("INFO", "simtune"):
            tune(config_of(tmp_path / "run", budget_minutes=minutes))
        assert "a round takes about 300 s here" in caplog.text
        for budget, note in said.items():
            assert (note in caplog.text) == (budget == minutes)


@pytest.mark.parametrize(
    ("least_s", "whole_s", "first_s", "answer", "verdicts"),
    [
        (100.0, 300.0, 0.0, "3.7", 6),
        (100.0, 300.0, 60.0, "4.7", 7),
        (100.0, 300.0, 1e4, "7.4", 11),  # readings take half of all time at most
    ],
)
def test_time_for_verdicts_has_that_for_readings_in_it(
    caplog, least_s, whole_s, first_s, answer, verdicts
):
    needed = TimeNeeded(least_s, whole_s, first_s=first_s)
    enough = f"verdicts need --budget-minutes {verdicts}, an answer --budget-minutes {answer} or"
    with pytest.raises(InputError, match=enough):
        enough_time.refuse_if_too_short(1.0, 20.0, needed)
    with caplog.at_level("INFO", "simtune"):
        enough_time.refuse_if_too_short(1.5, 20.0, needed)
    assert f"nothing can be called identified: {verdicts} are enough" in caplog.text
    caplog.clear()
    with caplog.at_level("INFO", "simtune"):
        enough_time.refuse_if_too_short(verdicts, 20.0, needed)
    assert "--budget-minutes" not in caplog.text


@pytest.mark.parametrize("loading_s", [0, 20])
@pytest.mark.parametrize(("real", "counted_s"), [("lerobot", 0), ("pseudo", 300), ("film", 300)])
def test_what_libraries_take_to_load_but_no_robot_to_film_is_part_of_the_budget(
    real, counted_s, loading_s, tmp_path, monkeypatch
):
    def build(*_) -> SimpleNamespace:
        now_s[0] += 300.0  # to film, or to read recordings
        search = SimpleNamespace(measure_time=lambda real: TimeNeeded(0.0, 0.0))
        return SimpleNamespace(search=search, recordings=[], warnings=lambda recordings: [])

    now_s, at_the_end_s = [0.0], 30.0
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    monkeypatch.setattr(tuning_run, "build_experiment", build)
    config = config_of(tmp_path / "run", real=real, budget_minutes=0.1)
    beside_s = loading_s + counted_s + at_the_end_s
    with pytest.raises(InputError, match=f"about {beside_s:.0f} s beside"):
        tune(config, loading_s=loading_s)


def test_a_time_too_short_for_a_search_that_cannot_tell_names_no_round():
    enough_time.refuse_if_too_short(0.4, 20.0, TimeNeeded(0.0, 0.0))
    with pytest.raises(InputError) as refused:
        enough_time.refuse_if_too_short(0.3, 20.0, TimeNeeded(0.0, 0.0))
    assert str(refused.value) == (
        "--budget-minutes 0.3 is too short: nothing can be searched in that time, as the run takes "
        "about 20 s beside the search; give more"
    )


@pytest.mark.parametrize(
    ("asked", "share"), [("1%", 0.01), ("0.5%", 0.005), ("0%", 0.0), ("2", 0.02), ("5 %", 0.05)]
)
def test_precision_is_a_percentage_that_the_search_gets(tmp_path, asked, share):
    config = config_of(tmp_path, precision=asked)
    config.check()
    search = choose_search_settings(config, "posterior", TASK, [], 64)
    assert isinstance(search, PosteriorSearchConfig)
    assert search.precision == pytest.approx(share)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"search": "paper", "precision": "5%"}, "--precision goes with --search posterior"),
        ({"search": "regression", "known_colour": "pole"}, "posterior, got regression"),
        ({"observe": "joints", "image_size": 128}, "--image-size goes with pictures, and --obs"),
    ],
)
def test_an_option_that_would_be_ignored_is_refused(changes, message, tmp_path):
    with pytest.raises(InputError, match=message):
        config_of(tmp_path, **changes).check()


@pytest.mark.thorough
def test_a_resumed_search_keeps_the_keypoints_it_was_trained_with(
    one_round, tmp_path, quick, monkeypatch
):
    module = "simtune.experiment.keypoints"
    monkeypatch.setattr(f"{module}.find_keypoints", find_others)
    resumed = build_experiment(config_of(one_round), settings=quick)
    new = build_experiment(config_of(tmp_path / "new"), settings=quick)
    assert resumed.keypoints.state() != new.keypoints.state()
    assert resumed.search.context.keypoints.state() == resumed.keypoints.state()
    checkpoint = newest(one_round / "checkpoints")
    assert load_state(checkpoint)["keypoints"] == resumed.keypoints.state()


# --- the truth ----------------------------------------------------------------------------


@pytest.mark.thorough
def test_the_truth_is_not_there_during_the_search_and_lies_in_scoring_change_nothing_else(
    finished, tmp_path, truth_file, quick, monkeypatch
):
    """The search has to do without what a Truth knows, but for the digest that tells it apart."""
    truths, hidden = [], []
    initialize, score, result = Truth.__init__, Truth.score, outcome.result

    def notice(truth, *given):
        truths.append(truth)
        initialize(truth, *given)

    def hide(*given):
        for truth in truths:
            hidden.append((truth, dict(vars(truth))))
            vars(truth).clear()
            truth.digest = hidden[-1][1]["digest"]
        return make_search(*given)

    def show(*given):
        for truth, known in hidden:
            vars(truth).update(known)
        return result(*given)

    def lie(truth, mean):
        real, error = score(truth, mean)
        return real * 0 + 123.0, error * 0 + 4.0

    monkeypatch.setattr(Truth, "__init__", notice)
    monkeypatch.setattr("simtune.experiment.experiment.make_search", hide)
    monkeypatch.setattr(outcome, "result", show)
    monkeypatch.setattr(Truth, "score", lie)
    lied = tune(config_of(tmp_path / "lies", real_parameters=truth_file), settings=quick)
    assert hidden
    assert lied["percent_error"] == 4.0
    for name, entry in finished.returned["parameters"].items():
        for key in ("initial", "mean", "low", "high", "verdict"):
            assert lied["parameters"][name][key] == entry[key]
    metrics = [read_jsonl(run / "metrics.jsonl") for run in (finished.out, tmp_path / "lies")]
    assert without_time(metrics[0]) == without_time(metrics[1])


def test_true_parameters_come_from_the_file(truth_file):
    real, _, truth = choose_real(RealConfig(real_parameters=truth_file), load_task("cartpole"), 64)
    assert isinstance(real, PseudoReal)
    assert truth is not None
    expected = [TRUTH.get(p.name, p.nominal) for p in SPACE]
    np.testing.assert_allclose(truth.score(SPACE.nominal)[0], expected)
    np.testing.assert_allclose(read_parameters(truth_file, SPACE), expected)


def test_parameters_as_runs_exports_and_people_write_them(tmp_path):
    path = tmp_path / "parameters.json"
    found = {"pole_mass": {"mean": 0.2, "low": 0.1}}
    for content in ({"pole_mass": 0.2}, {"parameters": {"pole_mass": 0.2}}, {"parameters": found}):
        path.write_text(json.dumps(content))
        assert SPACE.to_dict(read_parameters(path, SPACE))["pole_mass"] == 0.2
    path.write_text(json.dumps({"parameters": {"pole_mass": {"low": 0.1}}}))
    with pytest.raises(InputError, match=r"json: .* 'pole_mass' must be a finite number, got"):
        read_parameters(path, SPACE)
    path.write_text(json.dumps({"pole_mas": 0.2}))
    with pytest.raises(InputError, match=r"parameters\.json: no parameter 'pole_mas'"):
        read_parameters(path, SPACE)


def test_the_real_world_hands_out_frames_and_actions_only():
    simulator = load_task("cartpole").simulator(image_size=64)
    real = PseudoReal(simulator, SPACE.nominal, episode_steps=5, seed=0)
    public = {name for name in dir(real) if not name.startswith("_")}
    can = {"collect", "run_policy", "step_s", "observation"}
    assert public == {*can, "facts"}
    assert real.facts == {}
    for name in ("parameters", "real_parameters", "state", "states", "reward", "simulator"):
        with pytest.raises(AttributeError):
            getattr(real, name)
    # Whatever lies in its attributes: no simulator, no array; a function that films.
    for value in vars(real).values():
        assert isinstance(value, int | float | ObservationModel) or callable(value)
        assert not isinstance(value, np.ndarray)
        assert not hasattr(value, "parameters")
    (trajectory,) = real.collect(1)
    names = {f.name for f in dataclasses.fields(trajectory)}
    assert names == {"frames", "actions", "step_s", "readings"}
    assert trajectory.frames.dtype == np.uint8
    assert trajectory.actions.shape == (5, 1)

    # A policy that is tried out there sees its latest frames, and nothing else.
    def policy(*seen):
        (frames,) = seen
        assert frames.dtype == np.uint8
        assert frames.shape == (2, 3, 64, 64, 3)
        return np.full((2, 1), 0.5)

    begun: list[None] = []
    tried = real.run_policy(policy, 3, 2, seed=0, begin=lambda: begun.append(None))
    assert len(begun) == 1  # both episodes at once
    names = {f.name for f in dataclasses.fields(tried[0])}
    assert names == {"frames", "actions", "step_s", "readings"}
    np.testing.assert_array_equal(tried[1].actions, np.full((5, 1), 0.5))


def test_a_pseudo_real_worlds_actions_are_drawn_apart_from_the_start():
    drawn: list[np.ndarray] = []

    def explore(num_worlds: int, num_steps: int, rng: np.random.Generator) -> None:
        drawn.append(rng.random(9))
        raise RuntimeError("enough is seen")

    simulator = SimpleNamespace(step_s=0.05, explore=explore)
    with pytest.raises(RuntimeError, match="enough"):
        PseudoReal(simulator, SPACE.nominal, episode_steps=5, seed=0).collect(1)
    assert not np.isin(drawn, np.random.default_rng(0).random(100)).any()


def test_a_pseudo_real_world_of_which_all_episodes_diverge_says_so(monkeypatch):
    simulator = load_task("cartpole").simulator(image_size=64)

    def lose_all(*given, **options):
        played = play(*given, **options)
        return dataclasses.replace(played, lengths=np.zeros_like(played.lengths))

    play = simulator.play
    monkeypatch.setattr(simulator, "play", lose_all)
    real = PseudoReal(simulator, SPACE.nominal, episode_steps=5, seed=0)
    with pytest.raises(RuntimeError, match="diverged"):
        real.collect(2)


def test_starts_are_twice_or_half_the_truth_by_the_seed():
    truth = Truth(SPACE, read_parameters(None, SPACE))
    starts = np.array([truth.wrong_start(seed) for seed in range(40)])
    doubled, halved = 2 * SPACE.nominal, SPACE.nominal / 2
    assert ((starts == doubled) | (starts == halved)).all()
    may_double = doubled <= SPACE.high
    assert (~may_double).any(), "a colour above .5"
    np.testing.assert_array_equal((starts == doubled).any(0), may_double)
    assert (starts == halved).any(0).all()
    np.testing.assert_array_equal(starts[7], truth.wrong_start(7))


def test_what_is_0_or_may_be_negative_starts_away_from_its_truth_as_well():
    """A tenth of a delay's range and half of an angle's are their sizes: half of these."""
    each = {"objects": ("joint",), "unit": "s", "scale": "linear"}
    delay = Parameter(**each, name="delay", field="actuator_delay", nominal=0, low=0, high=0.2)
    angle = Parameter(**each, name="angle", field="qpos0", nominal=0.02, low=-0.1, high=0.1)
    space = ParameterSpace([delay, angle])
    starts = np.array([Truth(space, space.nominal).wrong_start(seed) for seed in range(20)])
    np.testing.assert_allclose(starts[:, 0], 0.01)
    assert set(starts[:, 1].round(6)) == {-0.03, 0.07}


def test_percent_error_equals_hand_calculation():
    truth = Truth(SPACE, SPACE.nominal)
    real, error = truth.score(SPACE.nominal * np.linspace(0.5, 1.5, len(SPACE)))
    np.testing.assert_array_equal(real, SPACE.nominal)
    np.testing.assert_allclose(error, np.abs(np.linspace(-50, 50, len(SPACE))), atol=1e-9)
    real[:] = 0  # a copy: the truth stays as it is
    np.testing.assert_array_equal(truth.score(SPACE.nominal)[0], SPACE.nominal)


def test_a_truth_of_0_is_beside_a_hundredth_of_the_farther_bound():
    fields = {"field": "qpos0", "objects": ("joint",), "unit": "rad", "nominal": -0.05}
    space = ParameterSpace([Parameter(name="zero", low=-0.1, high=0.0, scale="linear", **fields)])
    _, error = Truth(space, np.zeros(1)).score(np.array([-0.002]))
    np.testing.assert_allclose(error, [200])


# --- the pieces ---------------------------------------------------------------------------


def test_estimates_survive_json():
    curves = {"pole_mass": (np.array([0.1, 0.2]), np.array([1.0, 0.25]))}
    numbers = (np.array([0.1 + i, math.pi]) for i in range(3))
    estimate = Estimate(*numbers, ["weak", "identified"], curves)
    back = Estimate.from_json(json.loads(json.dumps(estimate.to_json())))
    for key in ("mean", "low", "high"):
        np.testing.assert_array_equal(getattr(back, key), getattr(estimate, key))
    assert back.verdict == estimate.verdict
    assert back.correlation is None
    known = dataclasses.replace(
        estimate, correlation=np.array([[1, math.pi / 4], [math.pi / 4, 1]])
    )
    back = Estimate.from_json(json.loads(json.dumps(known.to_json())))
    np.testing.assert_array_equal(back.correlation, known.correlation)
    for got, expected in zip(back.curves["pole_mass"], curves["pole_mass"], strict=True):
        np.testing.assert_array_equal(got, expected)


def test_an_estimate_of_another_version_names_both_versions():
    saved = Estimate(*np.zeros((3, 2)), ["weak", "weak"]).to_json()
    with pytest.raises(InputError, match=r"simtune 9\.1, and simtune \S+ has other .* \(shape\)"):
        Estimate.from_json(saved | {"simtune": "9.1", "shape": 1})
    for name in ("verdict", "simtune"):
        del saved[name]
    with pytest.raises(InputError, match=r"simtune \(an older version\), .* \(verdict\): go on"):
        Estimate.from_json(saved)


@pytest.mark.thorough
def test_the_start_of_an_episode_is_found_in_its_pictures(one_renderer_each):
    config = StartSearchConfig(num_starts=192)
    task = load_task("ball_in_cup")
    simulator = task.simulator(image_size=32)
    parameters = task.parameters.nominal
    (trajectory,) = PseudoReal(simulator, parameters, episode_steps=6, seed=11).collect(1)
    rng = np.random.default_rng(0)

    def distance(starts: np.ndarray) -> np.ndarray:
        """Mean squared difference of the first pictures."""
        frames = simulator.render(starts, np.tile(parameters, (len(starts), 1)))
        return np.square(frames.astype(float) - trajectory.frames[0]).mean((1, 2, 3))

    found = start_search.find_start(simulator, trajectory, parameters, rng, config=config)
    actions = np.zeros((64, 1, simulator.num_actions))
    others = simulator.roll_out(np.tile(parameters, (64, 1)), actions, rng).states[:, 0]
    assert distance(found[None])[0] < 0.1 * np.median(distance(others))


def test_what_a_servo_remembers_goes_with_the_start_that_is_found():
    """A slow servo that displaces its cart from where it is: its filter settled there."""
    task = dataclasses.replace(
        TASK,
        load_spec=partial(cartpole_with_servo, kv=2, timeconst=0.15),
        map_actions=partial(JointActions, per_unit=0.3),
    )
    simulator, config = task.simulator(image_size=40), StartSearchConfig(num_starts=16, rounds=3)
    real = Trajectory(
        np.full((5, 40, 40, 3), 90, np.uint8), np.full((4, 1), 0.5, np.float32), simulator.step_s
    )
    start = start_search.find_start(
        simulator, real, SPACE.nominal, np.random.default_rng(0), config
    )
    (act,) = start[simulator.state_space.remembered]
    gear = simulator.model.actuator_gear[0, 0]
    assert act == pytest.approx(gear * (start[1] + 0.3 * 0.5))


def test_films_begin_where_the_fit_found_the_start_or_else_where_one_is_found(
    tmp_path, monkeypatch, one_renderer_each
):
    config = StartSearchConfig(num_starts=8, rounds=1)
    simulator, parameters = TASK.simulator(image_size=32), SPACE.nominal
    # Where the task never begins: the cart far off, the pole hanging.
    began = simulator.roll_out(parameters[None], np.zeros((1, 1, 1)), np.random.default_rng(0))
    began = began.states[:, 0]
    began[0, 1:3] = 1.1, np.pi
    played = simulator.roll_out(parameters[None], np.zeros((1, 6, 1)), None, starts=began)
    film = Trajectory(simulator.film(played)[0], np.zeros((6, 1), np.float32), simulator.step_s)
    filmed = []

    def watch(simulator, real, parameters, start, late_steps):
        filmed.append(start)
        return film_from(simulator, real, parameters, start, late_steps)

    film_from = videos.film_from
    monkeypatch.setattr(videos, "film_from", watch)
    estimate = Estimate(parameters, SPACE.low, SPACE.high, ["weak"] * len(SPACE), {})
    for start, is_there in ((began[0].tolist(), True), (None, False)):
        found = dataclasses.replace(estimate, start=start)
        late, at = start_search.episode_and_start(simulator, film, found, 0, config)
        videos.write_videos(tmp_path, simulator, late, at, (parameters, parameters))
        one, other = filmed[-2:]  # before and after
        np.testing.assert_array_equal(one, other)
        assert np.array_equal(one, began[0]) == is_there
        after = np.stack([frame for _, frame in decode(tmp_path / "after.mp4")]).astype(float)
        distance = np.abs(after - film.frames).mean()
        assert (distance < 3) == is_there, distance  # video compression


def test_films_are_as_late_as_the_pictures():
    states = np.array([[0.0, 4.0], [1.0, 2.0], [3.0, 0.0]])
    assert seen_late(states, 0.0) is states
    late = seen_late(states, 0.25)
    np.testing.assert_allclose(late, [[0.0, 4.0], [0.75, 2.5], [2.5, 0.5]])
    soon = seen_late(states[None], -0.5)[0]
    np.testing.assert_allclose(soon, [[0.5, 3.0], [2.0, 1.0], [3.0, 0.0]])
    np.testing.assert_array_equal(seen_late(states[:1], 0.5), states[:1])


def test_a_world_that_diverges_is_shown_by_its_first_picture(monkeypatch, one_renderer_each):
    task = load_task("cartpole")
    simulator = task.simulator(image_size=64)
    rng = np.random.default_rng(0)
    start = simulator.roll_out(SPACE.nominal[None], np.zeros((1, 1, 1)), rng).states[0, 0]
    start[2] = np.nan
    real = Trajectory(np.zeros((4, 64, 64, 3), np.uint8), np.zeros((3, 1), np.float32), 0.02)
    frames = videos.film_from(simulator, real, SPACE.nominal, start)
    assert frames.shape == (1, 64, 64, 3)


def test_a_start_is_searched_for_no_longer_than_is_said(monkeypatch, one_renderer_each):
    simulator = TASK.simulator(image_size=32)
    real = Trajectory(np.zeros((5, 32, 32, 3), np.uint8), np.zeros((4, 1), np.float32), 0.02)
    filmed, render = [], simulator.render
    monkeypatch.setattr(simulator, "render", lambda *a: filmed.append(len(a[0])) or render(*a))
    for seconds, batches in ((0.0, 1), (1e6, 8 + 5)):  # all starts, and five rounds near the best
        filmed.clear()
        config = StartSearchConfig(num_starts=256, seconds=seconds)
        rng = np.random.default_rng(0)
        start_search.find_start(simulator, real, SPACE.nominal, rng, config)
        assert len(filmed) == batches


@pytest.mark.parametrize("search", ["paper", "regression"])
@pytest.mark.slow
def test_the_papers_searches_write_the_files_of_the_default_search(tmp_path, quick, search):
    out = tmp_path / search
    config = config_of(out, search=search, budget_minutes=1e-3)
    result = tune(config, settings=dataclasses.replace(quick, search=None))
    assert result["search"] == search
    assert set(result["parameters"]) == set(SPACE.names)
    assert (out / "report.html").is_file()
    (line,) = read_jsonl(out / "metrics.jsonl")
    assert line["round"] == 1
    assert result["stopped"].startswith("the time is over")
