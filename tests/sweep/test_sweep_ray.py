"""A sweep on a Ray cluster of three nodes, all of them on this machine."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import pytest
from places import SUPPORT
from sweep_driver import STAND_IN

from simtune.config import SweepConfig
from simtune.errors import InputError
from simtune.sweep import sweep

ray = pytest.importorskip("ray")
cluster_utils = pytest.importorskip("ray.cluster_utils")

pytestmark = pytest.mark.slow

GRID = '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nbudget_minutes = 2\nseed = SEEDS\n'
_RUNS = 60
TRAININGS = """
[[runs]]
command = "train"
task = "cartpole"
method = ["dr", "oracle"]
policy_steps = 1000
scored_episodes = 1
seed = [0, 1]
"""


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Three nodes of one core each; what they start finds simtune and the tests."""
    paths = [str(SUPPORT), *sys.path]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    monkeypatch.setenv("STAND_IN", str(tmp_path))
    short = tempfile.mkdtemp(prefix="ray-")  # paths of its sockets must be
    monkeypatch.setenv("TMPDIR", short)  # other sweeps of this machine hold its cores
    monkeypatch.setattr("tempfile.tempdir", None)
    started = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    for _ in range(2):
        started.add_node(num_cpus=1)
    yield started
    ray.shutdown()
    started.shutdown()
    shutil.rmtree(short, ignore_errors=True)


def results(out: Path) -> dict[str, dict]:
    return {run["name"]: run for run in json.loads((out / "sweep.json").read_text())["runs"]}


def lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.exists() else []


def test_a_cluster_finds_the_same_as_this_machine_to_the_last_bit(cluster, tmp_path):
    grid = tmp_path / "grid.toml"
    grid.write_text(TRAININGS)
    sweep(SweepConfig(grid=grid, out=tmp_path / "ray", ray=cluster.address))
    sweep(SweepConfig(grid=grid, out=tmp_path / "here", workers=1))
    assert {run["status"] for run in results(tmp_path / "ray").values()} == {"done"}
    for path in sorted((tmp_path / "here" / "runs").iterdir()):
        ours, theirs = (
            json.loads((tmp_path / where / "runs" / path.name / "result.json").read_text())
            for where in ("here", "ray")
        )
        for of_time in ("wall_s", "command"):
            del ours[of_time], theirs[of_time]
        assert ours == theirs


def start_driver(folder: Path, address: str) -> subprocess.Popen:
    script = SUPPORT / "sweep_driver.py"
    with (folder / "driver.txt").open("a") as said:
        command = [sys.executable, script, folder / "grid.toml", folder / "out", address]
        return subprocess.Popen(command, stdout=said, stderr=said)


def test_kills_at_random_lose_and_double_nothing(cluster, tmp_path, monkeypatch):
    """Of runs, Ray's workers, whole nodes, and the driver."""
    monkeypatch.setenv("STAND_IN_STEP_S", "0.1")
    (tmp_path / "grid.toml").write_text(GRID.replace("SEEDS", str(list(range(_RUNS)))))
    rng, killed = random.Random(0), Counter[str]()
    driver, end_s = start_driver(tmp_path, cluster.address), time.monotonic() + 500
    while driver.poll() != 0:
        assert time.monotonic() < end_s, "it never ends"
        if driver.poll():  # it was connected to a node that was killed
            driver = start_driver(tmp_path, cluster.address)
        time.sleep(rng.uniform(0, 1))
        if not (begun := lines(tmp_path / "begun")):
            continue
        what = ("run", "worker", "node", "driver")[killed.total() % 4]
        _, run, worker, _ = begun[-1].split()
        if what == "driver":
            driver.kill()
            driver.wait()
        elif what == "node":
            cluster.remove_node(next(iter(cluster.worker_nodes)), allow_graceful=False)
            cluster.add_node(num_cpus=1)
        else:
            try:
                os.kill(int(worker if what == "worker" else run), signal.SIGKILL)
            except ProcessLookupError:
                continue
        killed[what] += 1
    found = results(tmp_path / "out")
    assert len(found) == _RUNS
    assert {run["status"] for run in found.values()} == {"done"}
    assert not lines(tmp_path / "doubled")
    assert len(killed) == 4
    assert killed.total() >= 8


def test_no_cluster_is_said_in_one_line(tmp_path):
    grid = tmp_path / "grid.toml"
    grid.write_text(GRID.replace("SEEDS", "[0]"))
    config = SweepConfig(grid=grid, out=tmp_path / "out", ray="127.0.0.1:1")
    began_s = time.monotonic()
    with pytest.raises(InputError, match="no cluster can be reached"):
        sweep(config, STAND_IN)
    assert time.monotonic() - began_s < 120
