"""`report --rerun`: what goes into the file, with the viewer's own package where there is one."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from simtune.before_after.moving_parts import MovingParts
from simtune.errors import InputError
from simtune.recordings import write_video
from simtune.report.rerun_file import write_rerun
from simtune.run.files import write_json


@pytest.fixture
def run(tmp_path) -> Path:
    """A run with a video of 5 frames, a joint over 4 rows, and two rounds of a parameter."""
    folder = tmp_path / "run"
    (folder / "videos").mkdir(parents=True)
    frames = np.random.default_rng(0).integers(0, 255, (5, 32, 32, 3), np.uint8)
    write_video(folder / "videos" / "real.mp4", frames, 20.0)
    elbow = {"measured": [0.0, 0.1, None, 0.3], "after": [0.0, 0.1, 0.2, 0.3], "unit": "rad"}
    points = np.arange(12.0).reshape(3, 2, 2)
    points[1, 0] = np.nan  # not seen
    keypoints = MovingParts(("arm", "cup"), points, points + 1, points + 2).to_json()
    replayed = {"step_s": 0.05, "sensors": {"elbow": elbow}, "keypoints": keypoints}
    write_json(folder / "replay.json", replayed)
    parameter = {"mean": 2.0, "low": 1.0, "high": 3.0}
    result = {"task": "arm", "parameters": {"mass": parameter}, "sensors": {"elbow": {}}}
    write_json(folder / "result.json", result)
    write_json(folder / "config.json", {"config": {"task": "arm"}})
    figures = ("mean", "low", "high", "range_low", "range_high")
    lines = [{"round": i} | {f"{f}/mass": float(i) for f in figures} for i in (1, 2)]
    text = "".join(f"{line}\n".replace("'", '"') for line in lines)
    (folder / "metrics.jsonl").write_text(text)
    return folder


def test_videos_joints_and_estimates_go_on_their_timelines(run, tmp_path, monkeypatch):
    sent: dict[str, tuple] = {}
    stream = SimpleNamespace(
        save=lambda path: None,
        flush=lambda: None,
        log=lambda place, content, static: sent.update({f"{place} whole": (content, static)}),
        send_columns=lambda place, indexes, columns: sent.update({place: (*indexes, columns)}),
    )
    stamps_ns = np.arange(5) * 50_000_000
    fake = ModuleType("rerun")
    fake.RecordingStream = lambda name: stream
    fake.TimeColumn = lambda name, **times: (name, times)
    fake.Scalars = SimpleNamespace(columns=lambda scalars: scalars)
    fake.Points2D = SimpleNamespace(
        columns=lambda positions, labels: SimpleNamespace(
            partition=lambda lengths: (positions, labels, lengths.tolist())
        )
    )
    fake.VideoFrameReference = SimpleNamespace(columns_nanos=lambda stamps: stamps)
    fake.AssetVideo = lambda contents, media_type: SimpleNamespace(
        contents=contents, read_frame_timestamps_nanos=lambda: stamps_ns
    )
    monkeypatch.setitem(sys.modules, "rerun", fake)
    write_rerun(run, tmp_path / "run.rrd")
    video, static = sent.pop("videos/real whole")
    assert static
    assert video.contents == (run / "videos" / "real.mp4").read_bytes()
    (timeline, times), stamps = sent.pop("videos/real")
    assert timeline == "time"
    np.testing.assert_allclose(times["duration"], [0, 0.05, 0.1, 0.15, 0.2])
    np.testing.assert_array_equal(stamps, stamps_ns)
    (timeline, times), (positions, labels, lengths) = sent.pop("videos/real/keypoints")
    np.testing.assert_allclose(times["duration"], [0, 0.05, 0.1])
    assert (lengths, labels) == ([2, 1, 2], ["arm", "cup", "cup", "arm", "cup"])
    np.testing.assert_array_equal(positions[2], [6.5, 7.5])
    assert len(sent.pop("videos/before/keypoints")[1][0]) == 5
    assert len(sent.pop("videos/after/keypoints")[1][0]) == 5
    (timeline, times), values = sent.pop("joints/elbow/measured")
    np.testing.assert_allclose(times["duration"], [0, 0.05, 0.1, 0.15])
    np.testing.assert_array_equal(values, [0, 0.1, np.nan, 0.3])
    (timeline, times), values = sent.pop("estimates/mass/low")
    assert (timeline, times["sequence"].tolist(), values.tolist()) == ("round", [1, 2], [1.0, 2.0])
    assert sorted(sent) == ["estimates/mass/high", "estimates/mass/mean", "joints/elbow/after"]


def test_without_the_package_a_line_says_what_to_install(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"pip install rerun-sdk$"):
        write_rerun(run, tmp_path / "run.rrd")
    with pytest.raises(InputError, match="no such folder"):
        write_rerun(tmp_path / "none", tmp_path / "run.rrd")


@pytest.mark.slow
def test_the_viewers_own_package_reads_the_file(run, tmp_path):
    pytest.importorskip("rerun")
    write_rerun(run, tmp_path / "run.rrd")
    command = [sys.executable, "-m", "rerun", "rrd", "stats", tmp_path / "run.rrd"]
    told = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    for place in (
        "videos/real: 2",
        "videos/after/keypoints: 1",
        "joints/elbow/measured: 1",
        "estimates/mass/mean: 1",
    ):
        assert f"/{place}" in told
    with pytest.raises(InputError, match="cannot write"):
        write_rerun(run, tmp_path / "none" / "run.rrd")
