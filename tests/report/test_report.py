"""report.html: whole, offline, escaped, and made of whatever the run folder holds."""

import base64
import json
import re
import shutil
from dataclasses import asdict
from functools import cache
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from unittest import mock

import av
import matplotlib.path
import numpy as np
import pytest

from simtune.api.result import Result
from simtune.api.table import lines
from simtune.before_after.moving_parts import MovingParts
from simtune.before_after.videos import overlay
from simtune.cli.run_commands import _print_result
from simtune.errors import InputError
from simtune.export import how_sure
from simtune.report import write_report
from simtune.report.joint_plots import _lines, error_plot, reading_plot
from simtune.report.pair_plots import pair_plot
from simtune.report.plot import value_axis
from simtune.report.rank_plots import expected
from simtune.report.trust import Pair, mean_error
from simtune.report.words import diverging
from simtune.run.config import TIME_IS_OVER
from simtune.run.files import write_json
from simtune.run.folder import RunFolder
from simtune.run_data import read_run
from simtune.tasks import AnyTask, load_any_task
from simtune.tuning.search import Event

# name: (unit, truth, start, verdict)
_COLOURS = {"cup": (0.75, 0.6, 0.15), "ball": (0.6, 0.4, 0.3), "ground": (0.05, 0.15, 0.3)}
PARAMETERS = {"ball_mass": ("kg", 0.065, 0.13, "identified")} | {
    f"{name}_{channel}": ("1", truth, min(1.0, truth * (2 if i % 2 else 0.5)), verdict)
    for name, rgb in _COLOURS.items()
    for i, (channel, truth) in enumerate(zip("rgb", rgb, strict=True))
    for verdict in ["not identifiable" if (name, channel) == ("ground", "r") else "identified"]
}
PARAMETERS["ground_b"] = ("1", 0.3, 0.15, "weak")
RANKS = {  # of three known worlds: 27 of 30 between 0.05 and 0.95
    name: [round(0.02 + (0.31 * i + 0.37 * world) % 0.95, 4) for world in range(3)]
    for i, name in enumerate(PARAMETERS)
}
_WIDTHS = {"identified": 0.06, "weak": 0.35, "not identifiable": 2.0}


def make_run(path: Path, num_rounds: int = 4, finished: bool = True) -> Path:
    """A run folder as a tuning of ball_in_cup leaves it."""
    rng = np.random.default_rng(0)
    config = {"task": "ball_in_cup", "real": "pseudo", "search": "posterior", "seed": 3}
    parameters, curves = {}, {}
    with RunFolder.create(path, config | {"budget_minutes": 10}) as run:
        for round_ in range(1, num_rounds + 1):
            step, wall_s = 20_480 * round_, 97.3 * round_
            scalars: dict[str, float] = {"round": round_, "loss/spm": 0.69 / round_}
            for name, (unit, truth, start, verdict) in PARAMETERS.items():
                width = max(_WIDTHS[verdict], 0.45 ** (round_ - 1))
                drift = (start / truth) ** min(1, width)
                mean = truth * drift * np.exp(0.2 * min(1, width) * rng.normal())
                low, high = mean * np.exp(-width), mean * np.exp(width)
                wide = low * np.exp(-0.5 * width), high * np.exp(0.5 * width)
                if unit == "1":
                    mean, low, high, *wide = np.clip([mean, low, high, *wide], 0.001, 1)
                figures = dict(mean=mean, low=low, high=high, range_low=wide[0], range_high=wide[1])
                scalars |= {f"{key}/{name}": value for key, value in figures.items()}
                event, reason = "narrowed", "the 90 % interval is well inside"
                if name == "ball_mass" and round_ == 1:
                    event, reason = "widened", "the curve is still at 0.9 at the upper edge"
                if round_ == 1 or name == "ball_mass":
                    told = Event(event, name, *wide, reason)
                    run.logs.log_event(step, wall_s, asdict(told))
                candidates = np.linspace(*wide, 33)
                centred = np.log(candidates / mean) / width * 2.94
                prob_higher = 1 / (1 + np.exp(centred))
                curves[name] = {"candidates": candidates, "prob_higher": prob_higher}
                parameters[name] = {"unit": unit, "nominal": truth, "initial": start} | {
                    **{"mean": mean, "low": low, "high": high, "verdict": verdict, "real": truth},
                    **{"percent_error": 100 * abs(mean - truth) / truth, "interval_share": 0.25},
                }
            run.logs.log_metrics(step, 2 * round_, wall_s, scalars)
        run.write_curves(curves)
        for name, speed in (("real", 1.0), ("before", 0.6), ("after", 0.97)):
            _write_video(run.videos / f"{name}.mp4", speed)
        if finished:
            run.write_result(
                {"task": "ball_in_cup", "method": "tune", "search": "posterior", "seed": 3}
                | {"real_episodes": 8, "sim_steps": 81_920, "wall_s": 402.7}
                | {"real": "pseudo-real world", "command": "simtune tune ball_in_cup --seed 3"}
                | {"parameters": parameters, "warnings": ["ground_r cannot be seen."]}
                | {"ranks": RANKS, "correlations": {"ball_mass, cup_r": 0.71}}
            )
    return path


def _write_video(path: Path, speed: float) -> None:
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 84, 84, "yuv420p"
        y, x = np.mgrid[:84, :84]
        for t in range(75):
            frame = np.full((84, 84, 3), (28, 58, 92), np.uint8)
            frame[(y // 12 + x // 12) % 2 == 0] = (18, 40, 70)
            frame[50:64, 34:50] = (190, 150, 40)
            ball = (x - 42 - 25 * np.sin(speed * t / 6)) ** 2 + (y - 30 + 12 * np.cos(t / 9)) ** 2
            frame[ball < 30] = (160, 100, 80)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        file.mux(stream.encode())


class _Page(HTMLParser):
    """Checks that tags close in order, and keeps the text and the attributes."""

    _VOID = ("meta", "input", "br", "wbr", "link", "img")

    def __init__(self, html: str):
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self._VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if {"style", "script"} & set(self.open):
            return
        if self.words and self.tags[-1][0] == "wbr":  # one word goes on
            self.words[-1] += data
        else:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def count(self, tag: str) -> int:
        return sum(t == tag for t, _ in self.tags)


@pytest.fixture(autouse=True, scope="module")
def _built_in_tasks_are_kept():
    """To compile a task's model, for its content, takes longer than to write a page."""
    kept = cache(load_any_task)

    def load(source: str) -> AnyTask:
        return load_any_task(source) if source.endswith(".toml") else kept(source)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("simtune.tasks.load_any_task", load)
        yield


@pytest.fixture(scope="module")
def finished_run(tmp_path_factory) -> Path:
    return make_run(tmp_path_factory.mktemp("runs") / "demo")


@pytest.fixture
def run_path(finished_run, tmp_path) -> Path:
    """A finished run that a test may change."""
    return Path(shutil.copytree(finished_run, tmp_path / "demo"))


def _report(path: Path) -> tuple[str, _Page]:
    html = write_report(path).read_text(encoding="utf-8")
    return html, _Page(html)


def _edit(path: Path, change) -> None:
    value = json.loads(path.read_text())
    change(value)
    path.write_text(json.dumps(value))


def test_report_shows_everything(run_path):
    html, page = _report(run_path)
    for name, (_, truth, _, verdict) in PARAMETERS.items():
        assert name in page.text
        assert verdict in page.text
        assert f"{truth:.3g}" in page.text
    assert page.count("svg") == 2 * len(PARAMETERS) + 2
    assert page.count("video") == 3
    for words in ("8 of 10", "81,920", "6 min 43 s", "8 real episodes", "ground_r cannot be seen."):
        assert words in page.text
    assert "ball_mass widened to" in page.text
    assert "simtune tune ball_in_cup --seed 3" in page.text
    assert "mujoco_warp" in page.text
    assert "has not finished" not in page.text
    assert "$" not in page.text
    assert len(html) < 400_000


def test_report_needs_no_network(run_path):
    html, page = _report(run_path)
    for _, attributes in page.tags:
        for key in ("src", "href", "poster", "data", "action"):
            assert (attributes.get(key) or "data:").startswith("data:")
    assert not re.search(r"https?://|@import|url\(", html)


def test_report_escapes_what_it_shows(run_path):
    evil = "<script>alert('x')</script>\"&"

    def spoil(result):
        result["task"] = result["real"] = result["command"] = evil
        result["warnings"] = [evil]
        facts = result["parameters"].pop("ball_mass")
        result["parameters"][evil] = facts | {"unit": evil, "verdict": evil}
        result["ranks"] = {evil: [0.5]}
        result["correlations"] = {f"{evil}, cup_r": -0.9}

    _edit(run_path / "result.json", spoil)
    metrics = (run_path / "metrics.jsonl").read_text()
    (run_path / "metrics.jsonl").write_text(
        metrics.replace("/ball_mass", f"/{json.dumps(evil)[1:-1]}")
    )
    with (run_path / "events.jsonl").open("a") as file:
        file.write(json.dumps({"step": 1, "event": evil, "parameter": evil, "reason": evil}) + "\n")
    html, page = _report(run_path)
    assert "<script>alert" not in html
    assert page.count("script") == 1
    assert page.text.count("alert('x')") >= 5


def test_report_says_what_a_verdict_is_measured_by(run_path):
    page = _Page(write_report(run_path).read_text())
    assert "Of first range" in page.text
    assert 'at most 9.0 % is "identified", at most 60 % "weak"' in page.text
    result = json.loads((run_path / "result.json").read_text())
    for facts in result["parameters"].values():
        del facts["interval_share"]  # as an earlier version wrote it
    write_json(run_path / "result.json", result)
    assert "first range" not in _Page(write_report(run_path).read_text()).text


@pytest.mark.parametrize("search", ["paper", "regression"])
def test_report_of_a_search_without_intervals_calls_the_range_what_it_is(run_path, search):
    def searched(result):
        del result["ranks"], result["correlations"]
        result["search"] = search
        for facts in result["parameters"].values():
            facts["verdict"] = "weak"

    _edit(run_path / "result.json", searched)
    for of_intervals in ("curves.json", "events.jsonl"):
        (run_path / of_intervals).unlink()
    html, page = _report(run_path)
    assert "Searched range" in page.text
    assert "It is no interval: how far off the truth may be, this search does not tell." in html
    assert "This search gives no intervals, so nothing is judged here" in page.text
    assert "weak Not judged." in page.text
    for absent in ("90 %", "take the interval", "known worlds", "crosses one half", "identified,"):
        assert absent not in page.text
    assert "class='interval'" not in html
    table = repr(Result(read_run(run_path)))
    assert "searched range" in table
    for absent in ("90 %", "first range"):
        assert absent not in table
        assert absent not in page.text


def test_report_of_a_run_without_a_fit_speaks_of_none(run_path):
    """As in a gymnasium environment."""
    fitted = ("are fitted to the videos", "measured on known worlds")
    for words in fitted:
        assert words in _report(run_path)[0]
    _edit(run_path / "result.json", lambda result: result.update(ranks={}, held_out={}))
    html, page = _report(run_path)
    for words in fitted:
        assert words not in html
    assert "The curve in the second plot of each card is" in html
    assert "90 % interval" in page.text


def test_report_says_which_intervals_miss_a_known_truth(run_path):
    def miss(result):
        for facts in result["parameters"].values():
            facts |= {"low": facts["real"] / 2, "high": 2 * facts["real"]}
        result["parameters"]["ball_mass"] |= {"low": 0.07, "real": 0.065}
        result["parameters"]["cup_r"]["low"] = None

    _edit(run_path / "result.json", miss)
    html, page = _report(run_path)
    assert "8 of 9 intervals hold the truth" in page.text
    assert "0.065 outside" in page.text
    assert html.count("<b>outside</b>") == 1
    _edit(run_path / "result.json", lambda result: result.update(search="paper"))
    html, page = _report(run_path)  # low and high are no interval's ends
    assert "hold the truth" not in page.text
    assert "<b>outside</b>" not in html


def test_report_without_truth(run_path):
    def forget(result):
        for facts in result["parameters"].values():
            del facts["real"], facts["percent_error"]

    _edit(run_path / "result.json", forget)
    html, page = _report(run_path)
    assert "Truth" not in page.text
    assert "mean error" not in page.text
    assert "hold the truth" not in page.text
    assert "class='truth'" not in html


def test_report_with_known_worlds_shows_how_far_to_trust_intervals(run_path):
    html, page = _report(run_path)
    assert "How far to trust this" in page.text
    words = "3 known worlds, filmed and fitted in the same way: 27 of 30 of the 90 % intervals held"
    assert words in page.text
    assert "too few to judge by" in page.text
    assert html.count("class='bar'") == 10
    assert html.count("class='rank'") == 30


def test_five_known_worlds_are_enough_to_say_how_many_intervals_should_hold(run_path):
    five = {name: [*ranks, 0.4, 0.6] for name, ranks in RANKS.items()}
    _edit(run_path / "result.json", lambda result: result.update(ranks=five))
    _, page = _report(run_path)
    assert "5 known worlds" in page.text
    assert "47 of 50 of the 90 % intervals held the truth ; 45 should." in page.text
    assert "too few to judge by" not in page.text


@pytest.mark.parametrize(("num_rounds", "is_open"), [(1, False), (2, True)])
def test_changes_of_ranges_are_folded_after_a_single_round(tmp_path, num_rounds, is_open):
    html, _ = _report(make_run(tmp_path / "run", num_rounds=num_rounds))
    assert ("<details open>" in html) == is_open


@pytest.mark.parametrize(
    ("config", "videos", "joints"),
    [
        (
            {"policy_steps": 9, "real": "pseudo"},
            "Shown is the first of the latest episodes, of 8 in all.",
            "Only the plots are of the first of the latest episodes;",
        ),
        (
            {"policy_steps": 9, "real": "/recordings"},
            "Shown is the first of 8 episodes.",
            "Only the plots are of the first episode;",
        ),
    ],
)
def test_report_of_a_training_shows_its_latest_episodes(
    run_path, readings_run, config, videos, joints
):
    """It films again with what its policy has learnt, and these come first."""
    for path, said in ((run_path, videos), (readings_run, joints)):
        _edit(path / "config.json", lambda stored: stored["config"].update(config))
        assert said in " ".join(_report(path)[1].text.split())


def test_report_says_how_the_kept_back_episode_went(run_path):
    def told(episode: int | None, passed: bool | None, known: list[float | None]) -> str:
        sensors = {"keypoints": {"unit": "px", "distance": 0.41, "known_worlds": known}}
        held = {"episode": episode, "passed": passed, "sensors": sensors}
        _edit(run_path / "result.json", lambda result: result.update(held_out=held))
        return " ".join(_report(run_path)[1].text.split())

    text = told(8, True, [0.3, None, 0.52])
    assert "The last episode was kept back: nothing was fitted to it. The tuned simul" in text
    assert "that it can make. Keypoints are 0.410 px off; in known worlds 0.300 to 0.520." in text
    assert "Shown is the first of 8 episodes, one of those that the simulator was fit" in text
    text = told(8, False, [0.1])
    assert "The tuned simulator fails: by the recorded actions it does not move as the" in text
    assert "Keypoints are 0.410 px off; in known worlds 0.100." in text
    text = told(None, None, [])
    assert "No episode was kept back, which takes three" in text
    assert "it cannot be said how well" in text
    assert "Keypoints are 0.410 px off." in text
    assert "Shown is the first of 8 episodes." in text
    assert "within short stretches" not in text
    reading = {"elbow": {"unit": "rad", "offset": 0.0, "rms_before": 0.02, "rms": 0.03}}
    _edit(run_path / "result.json", lambda result: result.update(sensors=reading))
    text = told(8, None, [])
    assert "0.410 px off. That is within short stretches, each from a beginning that fits" in text


def test_report_says_in_words_what_was_done(run_path):
    def told(config: dict, **result) -> str:
        _edit(run_path / "config.json", lambda stored: stored["config"].update(config))
        _edit(run_path / "result.json", lambda its: its.update(result))
        return _report(run_path)[1].text

    assert "The simulator was tuned to a simulated truth " in told({}, real="pseudo")
    assert "was tuned to recordings: data/swing " in told({}, real="data/swing")
    assert "was tuned to a robot: xarm " in told({}, real="xarm")
    assert "by the paper's steps up or down to a" in told({}, real="pseudo", search="paper")
    policy = {"policy_steps": 9}
    assert "A policy was trained while the simulator was tuned" in told(policy, search="posterior")
    assert "around the start; nothing was tuned to a simulated truth" in told(policy, method="dr")


def test_a_run_that_goes_on_is_titled_by_its_task(tmp_path):
    config = {"task": "/home/me/arm/tune.toml", "task_name": "arm"}
    RunFolder.create(tmp_path / "run", config).close()
    assert "<h1>arm</h1>" in _report(tmp_path / "run")[0]


@pytest.mark.parametrize("low", [0.0084, 0.09, 1.7, 4.2, 30.0, 1234.0])
@pytest.mark.parametrize("times", [6, 9, 25, 36, 900])
def test_numbers_along_an_axis_do_not_touch(low, times):
    axis = value_axis([low, low * times], 44, 242, is_colour=False)
    ticks = axis.ticks(5)
    assert len(ticks) >= 2
    for a, b in pairwise(ticks):  # 11 px high digits are 6 px wide
        assert axis(b) - axis(a) > 6 * (len(f"{a:g}") + len(f"{b:g}")) / 2 + 4


def test_band_of_uniform_ranks():
    for num in (9, 72, 400):
        counts = np.random.default_rng(0).binomial(num, 0.1, 100_000)
        assert expected(num) == tuple(np.quantile(counts, (0.05, 0.95)))


@pytest.mark.parametrize(
    ("correlation", "kind", "weight", "said"),
    [
        (
            0.9,
            "ratio",
            1,
            "raising both changes the videos least, so their ratio, ball_mass / cup_r, is told "
            "better than either alone: 0.0867 , 90 % interval [0.0800, 0.0950] , truth 0.0867 "
            "(correlation 0.90)",
        ),
        (-0.7, "product", 1, "lowering the other changes the videos least, so their product, ball"),
        (-0.7, "product", 2, "ball_mass · cup_r 2 , is told better than either alone"),
        (0.9, "difference", 0.5, "their difference, ball_mass − 0.5 cup_r, is told"),
        (-0.9, "sum", 1, "their sum, ball_mass + cup_r, is told"),
        (0.9, None, 1, "neither is told well alone (correlation 0.90)"),
        (0.9, "ratio", None, "neither is told well alone (correlation 0.90)"),
    ],
)
def test_report_says_what_is_told_of_correlated_parameters(
    run_path, correlation, kind, weight, said
):
    def correlate(result):
        result["correlations"] = {"ball_mass, cup_r": correlation}
        found = {"a": "ball_mass", "b": "cup_r", "kind": kind, "weight": weight}
        found |= {"mean": 0.065 / 0.75, "low": 0.08, "high": 0.095, "correlation": correlation}
        result["combinations"] = [found, None, {"a": "gone"}]

    _edit(run_path / "result.json", correlate)
    assert said in _report(run_path)[1].text


def test_a_sensor_that_is_read_in_every_few_rows_is_one_line_and_holes_stay_open(readings_run):
    def lines_of(rows: np.ndarray) -> list[int]:
        """Numbers of points of the lines of what is measured in these of 200 rows."""
        measured = np.full(200, np.nan)
        measured[rows] = 1.0
        return [len(line) for line in _lines(np.arange(200.0), measured)]

    every = np.arange(1, 200, 3)
    assert lines_of(every) == [len(every)]
    assert lines_of(np.flatnonzero(np.arange(200) % 3)) == [133]  # of 20 Hz at 30 Hz
    assert lines_of(every[(every < 60) | (every > 90)]) == [20, 37]
    assert lines_of(np.r_[:50, 52:200]) == [50, 148]
    assert lines_of(np.r_[:50, 55, 60:200]) == [50, 140]
    assert lines_of(np.r_[7:8]) == lines_of(np.r_[:0]) == []
    long = np.full(2000, np.nan)
    long[1::3] = 1.0
    (line,) = _lines(np.arange(2000.0), long)
    assert line[0][0] == 1
    assert line[-1][0] == 1999
    assert 200 < len(line) < 300


def test_report_says_where_replays_diverge(readings_run):
    def lose(result):
        result["real_episodes"] = 8
        result["sensors"]["elbow"] |= {"rms_before": None, "diverged_before": 8}
        result["sensors"]["wrist"] |= {"rms_before": 0.1, "diverged": 2, "diverged_before": 8}

    _edit(readings_run / "result.json", lose)
    text = _report(readings_run)[1].text
    assert "Before tuning, the simulator diverges in every replay: nothing to compare." in text
    assert "As tuned, the simulator diverges in 2 of 8 replays: not counted." in text
    assert "5.12 mrad left in all episodes" in text
    assert "further off" not in text  # 0.75 rad of 0.1, which are other episodes
    assert diverging({"elbow": {"diverged": 1}}, None) == [
        "as tuned, the simulator diverges in 1 replay: not counted"
    ]


def test_report_says_how_far_off_each_moving_part_is_and_which_ends_farther(run_path, monkeypatch):
    film = np.zeros((10, 2, 2))
    parts = MovingParts(("ball", "cup"), film, film + 3, film + np.array([[4], [0]]))
    keypoints = {"step_s": 0.1, "keypoints": parts.to_json()}
    write_json(run_path / "replay.json", keypoints)
    _edit(run_path / "result.json", lambda r: r.update(moving_parts=parts.scores()))
    with monkeypatch.context() as patch:
        decoded = mock.Mock(side_effect=MovingParts.from_json)
        patch.setattr(MovingParts, "from_json", decoded)
        html, page = _report(run_path)
    assert decoded.call_count == 1  # it takes long where films are
    assert "ball 4.24 px 5.66 px 0 s 0 s cup 4.24 px 0 px 0 s to the end" in page.text
    assert "ball ends farther from the video after tuning than before" in page.text
    assert "from where the fit says it began" in page.text
    assert "what the fit is judged by" in page.text
    assert html.count("how far off, before and after") == 2
    assert "the detector is sure of" not in page.text
    near = {part: facts | {"end_px": 4.3} for part, facts in parts.scores().items()}
    _edit(run_path / "result.json", lambda r: r.update(moving_parts=near))
    assert "farther from the video" not in _report(run_path)[1].text  # 4.24 px before: hardly
    lost = {"px": None, "px_before": None}
    for given, says in (
        (
            {"ball": parts.scores()["ball"], "cup": lost},
            "sure of cup in no picture of the video. It",
        ),
        ({"ball": lost, "cup": lost}, "sure of ball, cup in no picture of the video. They"),
    ):
        _edit(run_path / "result.json", lambda r, given=given: r.update(moving_parts=given))
        assert f"–: the detector is {says}" in _report(run_path)[1].text
    _edit(run_path / "result.json", lambda r: r.update(moving_parts=parts.scores()))
    _edit(run_path / "result.json", lambda r: r.update(ranks={}))
    _, page = _report(run_path)
    assert "from where its first pictures look most like the video's" in page.text
    assert "the fit" not in page.text.partition("Error of the moving parts")[2].split("Times")[0]
    write_json(run_path / "replay.json", keypoints | {"keypoints": {"parts": [3]}})
    _edit(run_path / "result.json", lambda r: r.update(moving_parts={"ball": 3, "cup": {}}))
    assert "how far off, before and after" not in _report(run_path)[0]


def page_of_check(run_path: Path, half: float, **changes) -> str:
    """The page of a run whose ball_mass check told to 2 %, and which came out ±`half` percent."""

    def say(result):
        mass = result["parameters"]["ball_mass"]
        mass |= {"low": 0.06, "high": 0.06 * np.exp(half / 50), "verdict": "weak"}
        told = {"std_percent": 2 / 1.645, "verdict": "shows clearly", "note": ""}
        result["check"] = {"ball_mass": told | changes, "cup_r": {"verdict": "shows clearly"}}

    _edit(run_path / "result.json", say)
    return _report(run_path)[1].text


def test_report_shows_what_check_said_beside_what_came_out(run_path):
    assert "ball_mass ±2.00 % ±3.00 % 1.5 more episodes" in page_of_check(run_path, 3)
    assert "Why some" not in page_of_check(run_path, 3)
    said = page_of_check(run_path, 20, verdict="does not show")
    assert "ball_mass ±2.00 % ±20.0 % 10.0 other motions: these hardly show it" in said
    assert "Why some are much wider: There was time for only 3 known worlds" in said
    both = {"std_percent_at_best": 0.2 / 1.645}
    for half, came in ((20, "±20.0 % 10.0"), (1, "±1.00 % 1.0"), (0.1, "±0.100 % 0.5")):
        said = page_of_check(run_path, half, **both)
        assert f"ball_mass ±0.200 % to ±2.00 % {came} " in said
        assert "The first number is at best" in said
    said = page_of_check(run_path, 20, note="together with cup_r: see below")
    assert "motions that tell it from cup_r" in said
    _edit(run_path / "result.json", lambda r: r.update(stopped=TIME_IS_OVER))
    assert "ball_mass ±2.00 % ±20.0 % 10.0 more minutes" in page_of_check(run_path, 20)
    sensors = {"keypoints": {"unit": "px", "distance": 0.9, "known_worlds": [0.3, 0.2, 0.4]}}
    held = {"episode": 8, "passed": False, "sensors": sensors}
    _edit(run_path / "result.json", lambda r: r.update(held_out=held))
    said = page_of_check(run_path, 20)
    assert "first find what the model lacks" in said
    assert "3.0 times as far off as known worlds" in said
    # Lack of time would come first.
    facts = {"held_out": {}, "recordings": {"folder": "mine"}, "stopped": "all rounds are done"}
    wide = {"interval_share": 0.3, "verdict": "weak"}
    _edit(run_path / "result.json", lambda r: r.update(facts))
    _edit(run_path / "result.json", lambda r: r["parameters"]["cup_r"].update(wide))
    assert "cup_r seen in pictures – – a known colour" in page_of_check(run_path, 1)
    said = page_of_check(run_path, 1)
    assert "Expected by check" in said
    assert "half of a 90 % interval is 1.64 of them. Less than 1 is narrower than check" in said
    assert "or this interval is too narrow" in said
    assert "Less than 1" not in page_of_check(run_path, 2)
    _edit(run_path / "result.json", lambda r: r.update(check={"ball_mass": 3}))
    assert "Expected and actual precision" not in _report(run_path)[1].text


def test_what_would_tell_more_is_no_column_where_nothing_is_missing(run_path):
    assert "What would tell more" in page_of_check(run_path, 3)
    facts = {"verdict": "identified"}
    _edit(run_path / "result.json", lambda r: r["parameters"]["ball_mass"].update(facts))
    _, page = _report(run_path)
    assert "Expected by check" in page.text
    assert "What would tell more" not in page.text


@pytest.mark.parametrize(
    ("known", "declares", "stopped", "help_"),
    [
        (None, False, TIME_IS_OVER, "more minutes"),  # only three known worlds judged it
        (None, False, "all rounds are done", "a known colour: --known-colour"),
        (None, True, "all rounds are done", "more episodes"),
        ("ball", False, "all rounds are done", "more episodes"),
    ],
)
def test_a_known_colour_is_advised_where_there_is_none_and_time_was_enough(
    run_path, tmp_path, known, declares, stopped, help_
):
    """Also of a run without a fit, whose result has no camera's response."""
    card = '[[parameters]]\nname = "card"\nkind = "colour"\nobjects = "card"\n'
    other = card.replace("card", "other")
    (tmp_path / "card.xml").write_text(
        "<mujoco><worldbody><camera name='top'/><geom name='card' size='.1'/>"
        "<geom name='other' size='.1'/></worldbody></mujoco>"
    )
    head = 'model = "card.xml"\ncontrol_timestep_s = 0.05\n'
    (tmp_path / "card.toml").write_text(head + card + "known = true\n" + other)
    task = str(tmp_path / "card.toml") if declares else "ball_in_cup"
    facts = {"known_colour": known, "task": task, "task_content": load_any_task(task).content_hash}
    _edit(run_path / "config.json", lambda stored: stored["config"].update(facts))
    wide = {"interval_share": 0.3, "verdict": "weak"}
    _edit(run_path / "result.json", lambda r: r["parameters"]["cup_r"].update(wide))
    told = {"recordings": {"folder": "mine"}, "stopped": stopped}
    _edit(run_path / "result.json", lambda r: r.update(told))
    assert f"cup_r seen in pictures – – {help_} Half of" in page_of_check(run_path, 1)


def test_a_known_colour_is_called_known_not_found(run_path):
    content = load_any_task("ball_in_cup").content_hash
    before, found = _report(run_path)[1].text, [its[3] for its in PARAMETERS.values()]
    assert f"{found.count('identified')} of {len(found)} parameters identified" in before
    facts = {"known_colour": "cup", "task_content": content}
    _edit(run_path / "config.json", lambda stored: stored["config"].update(facts))
    text = _report(run_path)[1].text
    left = found.count("identified") - 3
    assert f"{left} of {len(found) - 3} parameters identified" in text
    row = lines(read_run(run_path))[1 + list(PARAMETERS).index("cup_g")].split()
    assert row[0] == "cup_g"
    assert row[3:5] == ["–", "known"]  # neither interval nor verdict
    assert re.search(r"cup_g – [\d.]+ [\d.]+ [\d.]+ – – known ", text)
    assert how_sure(run_path)[0] == f"{left} of {len(found)} parameters identified"
    assert "known: cup_r, cup_g, cup_b" in how_sure(run_path)
    wide = {"interval_share": 0.3, "verdict": "weak"}
    _edit(run_path / "result.json", lambda r: r["parameters"]["cup_r"].update(wide))
    assert "cup_r seen in pictures" not in page_of_check(run_path, 1)  # as nobody looked for it
    verdict = json.loads((run_path / "result.json").read_text())["parameters"]["cup_g"]["verdict"]
    assert verdict == "identified"


def test_a_known_colour_is_scored_by_nobody(run_path):
    """It was not searched: no interval of it holds the truth, nor is an estimate exact."""
    facts = {"known_colour": "cup", "task_content": load_any_task("ball_in_cup").content_hash}
    _edit(run_path / "config.json", lambda stored: stored["config"].update(facts))

    def miss(result):
        for name, its in result["parameters"].items():
            its["real"], its["percent_error"] = its["mean"], 0.0
            if not name.startswith("cup"):
                its["real"], its["percent_error"] = 2 * its["high"], 10.0

    _edit(run_path / "result.json", miss)
    page = _report(run_path)[1].text
    num = len(PARAMETERS) - 3
    assert f"0 of {num} intervals hold the truth" in page
    assert "10.0 % mean error" in page
    said: list[str] = []
    _print_result(read_run(run_path).result, run_path, said.append)
    assert f"0 of {num} intervals hold the truth" in said
    assert "mean error 10.0 %" in said
    _edit(run_path / "result.json", lambda r: r["parameters"]["cup_r"].update(real=9.0))
    assert _report(run_path)[0].count("<b>outside</b>") == num  # of intervals that there are


def test_the_numbers_of_one_camera_pose_are_no_pairs(run_path):
    """They always go together; what else goes with one of them is named."""

    def add_pose(result):
        for axis in ("x", "y", "z", "pitch", "yaw", "roll"):
            result["parameters"][f"front_{axis}"] = result["parameters"]["ball_mass"]
        result["correlations"] = {"front_x, front_yaw": 0.9, "ball_mass, front_z": 0.8}
        result["combinations"] = []

    _edit(run_path / "result.json", add_pose)
    text = _report(run_path)[1].text
    assert "The six numbers of front are one pose" in text
    assert "Where it stands goes together with ball_mass : known more exactly" in text
    assert "Told together" not in text
    _edit(run_path / "result.json", lambda r: r["parameters"].pop("front_roll"))  # no pose any more
    text = _report(run_path)[1].text
    assert "one pose" not in text
    assert "ball_mass and front_z : raising both" in text
    assert "front_x and front_yaw : raising both" in text


def write_posterior(path: Path, correlation: float, num: int = 1000) -> np.ndarray:
    """Normal draws of all parameters around their truths, the first two correlated."""
    names, matrix = list(PARAMETERS), np.eye(len(PARAMETERS))
    matrix[0, 1] = matrix[1, 0] = correlation
    truths = np.array([truth for _, truth, _, _ in PARAMETERS.values()])
    rng = np.random.default_rng(0)
    draws = truths * (1 + 0.05 * rng.multivariate_normal(np.zeros(len(names)), matrix, num))
    np.savez(path / "posterior.npz", names=names, draws=draws, correlation=matrix)
    return draws


def test_report_draws_pairs_with_a_contour_that_holds_three_of_four(run_path):
    draws = write_posterior(run_path, 0.9)
    _edit(run_path / "result.json", lambda r: r.update(correlations={"ball_mass, cup_r": 0.9}))
    html, page = _report(run_path)
    assert page.count("svg") == 2 * len(PARAMETERS) + 3
    assert 200 < html.count("class='draw'") <= 250 + 1  # and the legend's
    assert html.count("class='truth'") > 1
    pair = Pair(a="ball_mass", b="cup_r", correlation=0.9, combination=None)
    plot = pair_plot(read_run(run_path), pair)
    (contour,) = [mark for mark in plot.marks if mark.attributes.get("class") == "contour"]
    corners = [tuple(map(float, p.split(","))) for p in contour.attributes["points"].split()]
    pixels = [(plot.x(a), plot.y(b)) for a, b in draws[:, :2]]
    inside = matplotlib.path.Path(corners).contains_points(pixels)
    assert inside.mean() == pytest.approx(1 - np.exp(-(1.645**2) / 2), abs=0.03)
    extent = np.ptp(np.array(corners), 0)
    intervals = [plot.x(a) - plot.x(b) for a, b in [np.quantile(draws[:, 0], (0.95, 0.05))]]
    intervals += [plot.y(b) - plot.y(a) for a, b in [np.quantile(draws[:, 1], (0.95, 0.05))]]
    np.testing.assert_allclose(extent, intervals, rtol=0.02)
    # Rising: the lower left and the upper right corner are in it, the others are not.
    middle, spread = draws[:, :2].mean(0), draws[:, :2].std(0)
    ends = [middle + spread * sign for sign in ([1.2, 1.2], [-1.2, -1.2], [1.2, -1.2], [-1.2, 1.2])]
    ends = [(plot.x(a), plot.y(b)) for a, b in ends]
    assert matplotlib.path.Path(corners).contains_points(ends).tolist() == [
        True,
        True,
        False,
        False,
    ]


def test_report_shows_a_few_pairs_of_many(run_path):
    write_posterior(run_path, 0.9)
    names = list(PARAMETERS)
    told = {f"ball_mass, {name}": 0.6 + 0.01 * i for i, name in enumerate(names[1:])}
    told |= {f"cup_r, {name}": -0.95 for name in names[2:]}
    _edit(run_path / "result.json", lambda result: result.update(correlations=told))
    html, page = _report(run_path)
    assert page.count("svg") == 2 * len(PARAMETERS) + 2 + 6
    assert f"and {len(told) - 8} more, which result.json has" in page.text
    assert "cup_r and cup_g :" in page.text  # those that go together most
    assert "ball_mass and cup_r :" not in page.text
    assert len(html) < 500_000


def test_report_refuses_damaged_draws(run_path):
    for names, draws in ((["a"], np.ones((3, 2))), (["a"], np.full((3, 1), np.nan))):
        np.savez(run_path / "posterior.npz", names=names, draws=draws, correlation=np.eye(1))
        with pytest.raises(InputError, match=r"posterior\.npz is damaged"):
            write_report(run_path)


@pytest.mark.parametrize("nothing", [None, {}, {"ball_mass": []}, {"ball_mass, gone": "?"}])
def test_report_of_a_run_without_known_worlds(run_path, nothing):
    def forget(result):
        result["ranks"] = result["correlations"] = nothing
        if nothing is None:
            del result["ranks"], result["correlations"]

    _edit(run_path / "result.json", forget)
    _, page = _report(run_path)
    assert "How far to trust this" not in page.text
    assert page.count("svg") == 2 * len(PARAMETERS)


def test_report_without_videos_and_curves(run_path):
    shutil.rmtree(run_path / "videos")
    (run_path / "curves.json").unlink()
    _, page = _report(run_path)
    assert page.count("video") == 0
    assert page.count("svg") == len(PARAMETERS) + 2
    assert "requestAnimationFrame" not in (run_path / "report.html").read_text()


def test_the_script_comes_with_the_videos_that_it_plays(run_path):
    shutil.move(run_path / "videos" / "real.mp4", run_path / "videos" / "policy.mp4")
    assert _report(run_path)[1].count("script") == 1
    for name in ("before", "after"):
        (run_path / "videos" / f"{name}.mp4").unlink()
    assert _report(run_path)[1].count("script") == 0


def test_report_of_an_unfinished_run(run_path):
    (run_path / "result.json").unlink()  # and with it what known worlds showed
    with (run_path / "metrics.jsonl").open("a") as file:
        file.write('{"step": 99999, "mean/ball_')  # a crash left this
    _, page = _report(run_path)
    assert "has not finished" in page.text
    assert "ball_in_cup" in page.text
    assert "81,920" in page.text
    assert page.count("svg") == 2 * len(PARAMETERS)


def test_report_of_an_unfinished_training_has_the_last_rounds_estimates(tmp_path):
    """Lines about the policy follow those of a round."""
    with RunFolder.create(tmp_path / "run", {"task": "cartpole", "policy_steps": None}) as run:
        figures = {"mean/pole_mass": 0.1234, "low/pole_mass": 0.1, "high/pole_mass": 0.15}
        run.logs.log_metrics(0, 5, 60.0, {"round": 1} | figures)
        run.logs.log_metrics(3200, 5, 70.0, {"return/simulated": 1.0})
    _, page = _report(tmp_path / "run")
    assert "the figures are those of its last round; verdicts come at its end" in page.text
    assert "0.123" in page.text


def test_report_of_a_run_that_has_just_begun(tmp_path):
    RunFolder.create(tmp_path / "run", {"task": "walker"}).close()
    _, page = _report(tmp_path / "run")
    assert "No estimate has been made yet." in page.text
    assert "This run has not finished." in page.text


def test_report_copes_with_unknown_figures(run_path):
    def forget(result):
        result["parameters"]["ball_mass"] = {"mean": None, "low": float("nan")}
        result["wall_s"] = None

    _edit(run_path / "result.json", forget)
    _, page = _report(run_path)
    assert "ball_mass" in page.text
    assert "nan" not in page.text


def test_report_refuses_a_folder_without_a_run(tmp_path):
    with pytest.raises(InputError, match=r"is no run: it has no config\.json"):
        write_report(tmp_path)


def test_report_refuses_a_damaged_result(run_path):
    (run_path / "result.json").write_text('{"task": "ball')
    with pytest.raises(InputError, match=r"result\.json is damaged"):
        write_report(run_path)


# --- a policy -----------------------------------------------------------------------------


def test_a_trained_policy_is_shown_with_its_score_and_how_it_learnt(finished_run, tmp_path):
    path = Path(shutil.copytree(finished_run, tmp_path / "run"))
    assert "The policy" not in write_report(path).read_text()
    with (path / "metrics.jsonl").open("a") as lines:
        for i, earned in enumerate((10.0, 300.0, 280.0, 310.0)):
            entry = {"step": 90_000 + i, "return/simulated": earned, "filmed": float(i > 1)}
            lines.write(json.dumps(entry) + "\n")
    page = write_report(path).read_text()
    section = page[page.index("The policy") :]
    section = section[: section.index("</section>")]
    assert section.count("<polyline class='estimate'") == 1  # on pictures
    assert section.count("<polyline class='start'") == 1  # its teacher's
    assert "Scored" not in section
    result = json.loads((path / "result.json").read_text())
    score = {"mean": 321.0, "std": 4.5, "episodes": 10}
    (path / "result.json").write_text(json.dumps({**result, "return": score}))
    shutil.copy(path / "videos" / "real.mp4", path / "videos" / "policy.mp4")
    page = write_report(path).read_text()
    assert "return <b>321</b> ± 4.50" in page
    assert "It saw pictures, and no state." in page  # but perhaps its own latest actions
    assert "aria-label='the policy in the real world'" in page


@pytest.mark.parametrize("search", ["posterior", "paper"])
def test_what_a_template_leaves_out_leaves_no_dash(search, finished_run, tmp_path):
    path = Path(shutil.copytree(finished_run, tmp_path / "run"))
    _edit(path / "result.json", lambda result: result.update(search=search))
    html = write_report(path).read_text(encoding="utf-8")
    assert not re.search(r"<[a-z][^<>]*–>", html)
    assert not re.search(r"–\s*</article>", html)


@pytest.mark.parametrize("method", ["dr", "oracle"])
def test_report_of_methods_that_tune_nothing_shows_no_verdict(method, finished_run, tmp_path):
    path = Path(shutil.copytree(finished_run, tmp_path / "run"))
    result = json.loads((path / "result.json").read_text())
    untuned = {"method": method, "ranks": {}, "correlations": {}}
    (path / "result.json").write_text(json.dumps(result | untuned))
    words = " ".join(_Page(write_report(path).read_text()).words)
    assert "Worlds trained in" in words
    for absent in ("identified", "mean error", "Verdict", "How to read this"):
        assert absent not in words


def test_each_verdict_says_what_to_take(finished_run, tmp_path):
    path = Path(shutil.copytree(finished_run, tmp_path / "run"))
    result = json.loads((path / "result.json").read_text())
    mass = {"mean": 0.1, "low": 0.096, "high": 0.12, "verdict": "weak"}
    result["parameters"]["ball_mass"] |= mass
    result["parameters"]["cup_r"] |= {"mean": 0.5, "low": 0.48, "high": 0.53}
    (path / "result.json").write_text(json.dumps(result))
    words = " ".join(" ".join(_Page(write_report(path).read_text()).words).split())
    assert "4.0 % below and 20 % above the estimate: take the interval" in words
    assert "0.020 below and 0.030 above the estimate: take the estimate" in words
    assert "these videos do not tell; other actions, or another view, may" in words
    (path / "result.json").write_text(json.dumps(result | {"stopped": TIME_IS_OVER}))
    words = " ".join(" ".join(_Page(write_report(path).read_text()).words).split())
    assert "not told in this time" in words
    assert "more minutes may tell; else other actions, or another view, may" in words


def test_report_names_the_recordings_and_links_every_file(finished_run, tmp_path):
    path = Path(shutil.copytree(finished_run, tmp_path / "run"))
    shutil.copy(path / "videos" / "after.mp4", path / "videos" / "overlay.mp4")
    result = json.loads((path / "result.json").read_text())
    facts = {"folder": "a<b>", "kind": "pairs", "episodes": 5, "episodes_in_dataset": 8}
    camera = {"codec": "h264", "key": "front", "source_size": [480, 640]}
    camera["time_error_ms"] = {"largest": 12.5, "mean": 4}
    facts |= {"steps": 1000, "cameras": [camera]}
    facts |= {"fps": 30.0, "control_hz": 10.0}
    facts |= {"action_ranges": {"push": [-1, 0.5]}, "dataset_hash": "abc123"}
    (path / "result.json").write_text(json.dumps(result | {"recordings": facts}))
    page = _Page(write_report(path).read_text())
    words = " ".join(" ".join(page.words).split())
    assert "a<b>" in words
    assert "5 of 8, 1,000 steps" in words
    assert "640×480 pixels, h264, camera front" in words
    assert "at most 12.5 ms" in words
    assert "push -1.00 to 0.500" in words
    names = [a["download"] for tag, a in page.tags if tag == "a" and "download" in a]
    assert names == ["real.mp4", "before.mp4", "after.mp4", "overlay.mp4", "result.json"]
    (data,) = [a["href"] for tag, a in page.tags if a.get("download") == "result.json"]
    saved = json.loads(base64.b64decode(data.split(",")[1]))
    assert saved["recordings"] == facts


def test_an_overlay_is_grey_where_both_are_alike():
    real = np.full((3, 4, 4, 3), 100, np.uint8)
    simulated = real[:2].copy()  # that world diverged: its last picture stays
    simulated[:, 0, 0] = 200
    seen = overlay(real, simulated)
    assert seen.shape == real.shape
    np.testing.assert_array_equal(seen[:, 1:], 100)
    np.testing.assert_array_equal(seen[2, 0, 0], [100, 200, 200])


def test_report_shows_a_parameter_named_like_a_colour_as_a_number(finished_run, tmp_path):
    """Gears of three motors, say: drawn as numbers, and not as a swatch."""
    path = Path(shutil.copytree(finished_run, tmp_path / "run"))
    for name in ("config.json", "result.json", "metrics.jsonl", "curves.json"):
        text = (path / name).read_text()
        (path / name).write_text(re.sub(r"cup_([rgb])", r"gear_\1", text))
    lines = [json.loads(line) for line in (path / "metrics.jsonl").read_text().splitlines()]
    for line in lines:
        line |= {key: 20 + value for key, value in line.items() if "/gear_" in key}
    (path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    result = json.loads((path / "result.json").read_text())
    for name, entry in result["parameters"].items():
        if name.startswith("gear_"):
            entry |= {k: 20 + v for k, v in entry.items() if isinstance(v, float)}
    (path / "result.json").write_text(json.dumps(result))
    write_report(path)
    assert "gear_r" in (path / "report.html").read_text()


# --- joint readings -------------------------------------------------------------------------


def make_readings_run(path: Path) -> Path:
    """A run folder as a tuning by joint readings alone leaves it."""
    make_run(path)
    shutil.rmtree(path / "videos")
    times, rng = np.arange(221) / 30, np.random.default_rng(0)
    measured = np.sin(times)
    measured[50:60] = np.nan
    curves = {"unit": "rad", "measured": measured.tolist()}
    curves |= {"before": (measured + 0.2).tolist()}
    curves |= {"after": (measured + 0.005 * rng.normal(size=221)).tolist()}
    sensors = {name: curves for name in ("elbow", "wrist")}
    (path / "replay.json").write_text(json.dumps({"step_s": 1 / 30, "sensors": sensors}))

    def read(result):
        result["sensors"] = {
            "elbow": {"unit": "rad", "offset": -0.0123, "rms_before": 0.2, "rms": 0.00512},
            "wrist": {"unit": "rad", "offset": 0.0, "rms_before": None, "rms": 0.75},
        }
        result["recordings"] = {"camera": None, "readings": {"arm": ["state.elbow"]}}

    _edit(path / "result.json", read)
    return path


@pytest.fixture(scope="module")
def finished_readings_run(tmp_path_factory) -> Path:
    return make_readings_run(tmp_path_factory.mktemp("runs") / "readings")


@pytest.fixture
def readings_run(finished_readings_run, tmp_path) -> Path:
    """Such a run that a test may change."""
    return Path(shutil.copytree(finished_readings_run, tmp_path / "readings"))


def test_report_shows_joints_over_time_and_what_is_left(readings_run):
    html, page = _report(readings_run)
    assert page.text.count("Joints") == 1
    for words in ("200 mrad", "5.12 mrad", "-12.3 mrad", "0.750 rad", "arm: state.elbow"):
        assert words in page.text
    assert "5.12 mrad left of 200 mrad in all episodes" in page.text
    assert "Only the plots are of the first episode" in page.text
    assert page.count("svg") == 2 * len(PARAMETERS) + 2 + 4
    lines = html.count("class='measured'") - 1  # but for the legend's
    assert lines == 2 * 2  # each in two parts, around what was not read
    assert html.count("class='after'") == 4 * 2
    assert len(html) < 500_000


@pytest.mark.parametrize(
    ("after", "told"),
    [
        ({"elbow": 0.101, "wrist": 0.0896}, "after tuning, elbow is further off than before. Do"),
        ({"elbow": 0.101, "wrist": 0.12}, "after tuning, elbow, wrist are further off than befo"),
        ({"elbow": 0.02, "wrist": 0.0896}, None),
    ],
)
def test_report_warns_of_readings_that_tuning_made_worse(readings_run, after, told):
    sensors = {
        name: {"unit": "rad", "rms_before": 0.0895, "rms": its} for name, its in after.items()
    }
    _edit(readings_run / "result.json", lambda result: result.update(sensors=sensors))
    _, page = _report(readings_run)
    if told:
        assert f"Replays of the recordings that it was tuned to: {told}" in page.text
    else:
        assert "further off" not in page.text


def test_an_interval_wider_than_the_first_range_covers_over_100_percent(readings_run):
    def widen(result):
        result["parameters"]["ball_mass"]["interval_share"] = 1.99

    _edit(readings_run / "result.json", widen)
    _, page = _report(readings_run)
    assert "> 100 %" in page.text
    assert "199 %" not in page.text


def test_report_of_readings_alone_speaks_of_no_videos(readings_run):
    _, page = _report(readings_run)
    assert page.count("video") == 0
    assert page.count("script") == 0
    for word in ("video", "pixel", "side by side", "view"):
        assert word not in page.text.lower()
    assert "these recordings do not tell" in page.text
    assert "changes the recordings least" in page.text
    assert "output error" in page.text
    assert "Other actions may." in page.text


def test_what_shows_in_pictures_only_is_one_line_where_none_were_used(readings_run, run_path):
    colours = [name for name in PARAMETERS if name.endswith(("_r", "_g", "_b"))]
    said: dict[str, dict] = {name: {"verdict": "does not show", "note": ""} for name in PARAMETERS}
    for name in set(PARAMETERS) - set(colours):
        said[name]["std_percent"] = 3.0
    for run in (readings_run, run_path):
        _edit(run / "result.json", lambda result: result.update(check=said))
    html, page = _report(readings_run)
    line = f"{len(colours)} parameters show in pictures only: not looked at ({', '.join(colours)})."
    assert page.text.count(line) == 1
    motion = len(PARAMETERS) - len(colours)
    assert f"{motion} of {motion} parameters identified" in page.text
    assert f"{motion} of {motion} interval holds the truth" in page.text
    mass = read_run(readings_run).parameters["ball_mass"]
    assert mean_error(read_run(readings_run).looked_at) == mass["percent_error"]
    assert page.count("article") == motion + 2  # of what moves, and of two joints
    assert "<div class='colour'>" not in html
    assert read_run(readings_run).result["parameters"].keys() == set(PARAMETERS)
    found = Result(read_run(readings_run))
    said = line.partition(" (")[0]
    assert repr(found).splitlines()[2 + motion] == said
    assert f"<p>{said}</p>" in found._repr_html_()
    assert len(found.parameters) == len(PARAMETERS)
    _, page = _report(run_path)
    assert "in pictures only" not in page.text
    assert page.count("article") == len(PARAMETERS)


def test_without_a_check_the_task_says_what_shows_in_pictures_only(readings_run):
    """A short run says nothing of what to expect."""
    content = load_any_task("ball_in_cup").content_hash
    change = {"task_content": content}
    _edit(readings_run / "config.json", lambda stored: stored["config"].update(change))
    left_out = read_run(readings_run).not_looked_at
    assert left_out == [name for name in PARAMETERS if name.endswith(("_r", "_g", "_b"))]


def test_report_of_videos_and_readings_has_both(run_path):
    def read(result):
        result["sensors"] = {"elbow": {"unit": "rad", "offset": 0, "rms_before": 1, "rms": 0.1}}

    _edit(run_path / "result.json", read)
    _, page = _report(run_path)
    assert page.count("video") == 3
    assert "Joints" in page.text
    assert "The first episode" not in page.text  # nothing to draw
    assert "the joint readings beside it" in page.text
    assert "these videos do not tell" in page.text


@pytest.mark.parametrize(
    "replay",
    [
        {},
        {"sensors": []},
        {"step_s": None, "sensors": {"elbow": {"measured": [1, 2]}}},
        {"step_s": 0.1, "sensors": {"elbow": 3, "wrist": {"measured": "?", "after": [1, 2]}}},
        {"step_s": 0.1, "sensors": {"elbow": {"measured": [None, float("nan")], "after": [1]}}},
        {"step_s": 0.1, "sensors": {"elbow": {"unit": 3, "measured": []}}},
    ],
)
def test_report_copes_with_curves_that_are_not_there(readings_run, replay):
    (readings_run / "replay.json").write_text(json.dumps(replay))
    html, page = _report(readings_run)
    assert page.count("svg") == 2 * len(PARAMETERS) + 2
    assert "5.12 mrad" in page.text
    assert "The first episode" not in html


def test_what_is_left_is_drawn_in_thousandths(readings_run):
    run = read_run(readings_run)
    plot = error_plot(run, "elbow")
    texts = [mark.words for mark in plot.marks if mark.tag == "text"]
    assert "mrad" in texts
    assert "200" in texts
    assert (plot.y.low, plot.y.high) == pytest.approx((-20, 215), abs=12)
    after = [mark for mark in plot.marks if mark.attributes.get("class") == "after"]
    assert len(after) == 2
    assert reading_plot(run, "elbow").y.high == pytest.approx(1.2 + 0.06 * 2, abs=0.1)
    assert error_plot(run, "gone") is None


def test_curves_that_diverged_before_tuning_leave_the_others_to_be_seen(readings_run):
    def diverge(replay):
        replay["sensors"]["elbow"]["before"][100:] = [-1e3] * 121

    _edit(readings_run / "replay.json", diverge)
    run = read_run(readings_run)
    plot = reading_plot(run, "elbow")
    assert plot is not None
    assert -6 < plot.y.low < plot.y.high < 2
