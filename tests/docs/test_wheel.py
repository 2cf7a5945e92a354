"""The wheel, as `make dist` builds it, in an environment that does not know the repository."""

import fcntl
import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "simtune"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not importlib.util.find_spec("build"), reason="needs build (make install)"),
]


@pytest.fixture(scope="module")
def dist(tmp_path_factory) -> Path:
    """A folder with the sdist, and the wheel that is made of it."""
    out = tmp_path_factory.mktemp("dist")
    # Without isolation: this environment has setuptools, and nothing is to be fetched.
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", out, ROOT]
    # One of two test processes at a time: both would write into the repository's build folder.
    with (tmp_path_factory.getbasetemp().parent / "dist.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        subprocess.run(command, check=True, capture_output=True, timeout=300)
    return out


@pytest.fixture(scope="module")
def installed(dist, tmp_path_factory) -> Path:
    """Programs of an environment with the wheel alone.

    Its dependencies are this environment's, by a path: to install torch anew takes minutes. The
    editable simtune there is found by a file that such a path does not read.
    """
    folder = tmp_path_factory.mktemp("clean")
    venv.create(folder, with_pip=True)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    python = programs / "python"
    (wheel,) = dist.glob("*.whl")
    run(python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel)
    where = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    Path(where, "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return programs


def run(*command: str | Path, cwd: Path | None = None) -> str:
    """What a command prints, without this environment's paths."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_wheel_and_the_sdist_hold_every_file_of_the_package(dist):
    files = {
        path.relative_to(PACKAGE.parent).as_posix()
        for path in PACKAGE.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    listed = subprocess.check_output(["git", "ls-files", "examples"], cwd=ROOT, text=True)
    files |= {f"simtune/{name}" for name in listed.split() if not name.endswith(".gitignore")}
    assert {"simtune/py.typed", "simtune/report/templates/page.html"} <= files
    (wheel,), (sdist,) = dist.glob("*.whl"), dist.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        assert files == {n for n in archive.namelist() if ".dist-info/" not in n}
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {f"src/{name}" for name in files} | {"README.md", "LICENSE"} <= names


def test_the_wheel_works_without_the_repository(installed, tmp_path):
    python, simtune = installed / "python", installed / "simtune"
    where = run(python, "-c", "import simtune; print(simtune.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(installed.parent)
    assert "raycaster" in run(simtune, "doctor", cwd=tmp_path)
    code = "import simtune; print(simtune.load_task('rope_peg').load_model().nq)"
    assert int(run(python, "-c", code, cwd=tmp_path)) > 0  # its model is of the package's files
    run_folder = tmp_path / "run"
    run_folder.mkdir()
    (run_folder / "config.json").write_text('{"config": {"task": "rope_peg"}}')
    run(simtune, "report", run_folder, cwd=tmp_path)
    assert "rope_peg" in (run_folder / "report.html").read_text()


def test_an_example_of_the_wheel_can_be_tried_as_the_docs_say(installed, tmp_path):
    simtune = installed / "simtune"
    run(simtune, "example", "cart_pendulum", cwd=tmp_path)
    example = "examples/cart_pendulum"
    found = run(
        simtune, "check", f"{example}/tune.toml", "--real", f"{example}/recordings", cwd=tmp_path
    )
    assert "bob_mass" in found
    run(simtune, "example", "unitree_g1", cwd=tmp_path)
    assert os.access(tmp_path / "examples" / "unitree_g1" / "prepare.sh", os.X_OK)
    assert (tmp_path / "examples" / "unpack_wheel.py").is_file()


def test_the_wheel_tunes(installed, tmp_path):
    simtune = installed / "simtune"
    asked = ("--real", "pseudo", "--real-episodes", "3", "--budget-minutes", "1.5")
    run(simtune, "tune", "cartpole", *asked, "--out", "found", cwd=tmp_path)
    result = json.loads((tmp_path / "found" / "result.json").read_text())
    assert result["percent_error"] < 15  # it began at 50 to 100
    assert "pole_mass" in (tmp_path / "found" / "report.html").read_text()
    run(simtune, "export", "found", "--out", "tuned", cwd=tmp_path)
    assert (tmp_path / "tuned" / "model.xml").is_file()
