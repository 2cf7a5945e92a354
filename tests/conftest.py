"""What all tests share."""

import ctypes
import gc
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes.util import find_library
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch
from fake_xarm import FakeXArm
from robot_limits import LIMITS, STEP_S
from short_training import QUICK, short_episodes
from tiny_search import TINY_SEARCH

from simtune.algorithm import train
from simtune.checking.film.framing import FRAMINGS
from simtune.errors import InputError
from simtune.evaluation.evaluate import evaluate
from simtune.experiment.settings import Settings
from simtune.robot.latch import Latch
from simtune.robot.safe_arm import SafeArm
from simtune.robot.xarm import XArm
from simtune.simulation.rendering.renderer import make_renderer
from simtune.tasks import Task, load_task
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning_run import tune


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    """Networks and pictures here are tiny: threads would only wait, and each takes memory."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        if hasattr(os, "sched_getaffinity"):  # by which renderers count the cores
            patch.setattr(os, "sched_getaffinity", lambda process: {0})
        yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True, scope="session")
def _worlds_are_kept():
    """Searches here are so small that a seventh of their time goes into making worlds anew."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("simtune.simulation.simulator._BATCHES_KEPT", 8)
        yield


@pytest.fixture(autouse=True, scope="session")
def _imports_are_not_garbage():
    """Of 700,000 objects after imports none is ever freed: looking through all takes .6 seconds."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True, scope="module")
def _memory_given_back(_imports_are_not_garbage):
    """What a file's tests held, such as its renderers, is not held while the next file's run.

    What is left is needed on. Frozen, it is not looked through again after each of 180 files.
    """
    yield
    gc.collect()
    gc.freeze()
    if sys.platform == "linux" and (library := find_library("c")):
        trim = getattr(ctypes.CDLL(library), "malloc_trim", None)  # glibc has it
        if trim:
            trim(0)


@pytest.fixture(scope="session")
def tiny() -> PosteriorSearchConfig:
    """A posterior search that takes seconds and finds nothing."""
    return TINY_SEARCH


@pytest.fixture(scope="session")
def one_renderer_each():
    """Renderers by what they draw: each takes a second to make, and none keeps anything."""
    renderers = {}  # the latest few, each of 100 MB

    def make_once(model, space, view, settings):
        shapes = (model.cam_pos, model.cam_fovy, model.geom_size, model.geom_pos, model.body_pos)
        scene = (model.names, *(values.tobytes() for values in shapes))
        behind = None if view.plate is None else view.plate.tobytes()
        shown = (view.camera, view.aspect, behind, view.background_is_unknown)
        key = (scene, space.names, shown, replace(settings, views=()))
        renderer = renderers.pop(key, None)
        renderers[key] = renderer or make_renderer(model, space, view, settings)
        if len(renderers) > 3:
            del renderers[next(iter(renderers))]
        return renderers[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("simtune.simulation.rendering.renderers.make_renderer", make_once)
        yield


@pytest.fixture(scope="session")
def quick_settings(one_renderer_each) -> Settings:
    """Runs with these settings take seconds and find nothing."""
    return QUICK


@pytest.fixture
def quick(quick_settings) -> Iterator[Settings]:
    """For runs of seconds that find nothing, see `short_episodes`."""
    with short_episodes():
        yield quick_settings


@pytest.fixture(scope="module")
def quickly(quick_settings):
    """What `quick` is for one test, for fixtures of a module: a context in which to make runs."""

    @contextmanager
    def settings():
        with short_episodes():
            yield quick_settings

    return settings


@pytest.fixture
def quick_commands(monkeypatch, quick):
    """Makes `simtune tune` and `simtune train` quick: no option asks for such settings."""
    monkeypatch.setattr("simtune.tuning_run.tune", partial(tune, settings=quick))
    monkeypatch.setattr("simtune.algorithm.train", partial(train, settings=quick))
    monkeypatch.setattr("simtune.evaluation.evaluate.evaluate", partial(evaluate, settings=quick))


@pytest.fixture
def small_library(monkeypatch):
    """Films are compared with few of the simulator's pictures, and few of these with others.

    In few ways in which they may be framed, of which each kind is among.
    """
    monkeypatch.setattr("simtune.checking.film.library._WORLDS", 12)
    monkeypatch.setattr("simtune.checking.film.library._PICTURES", 8)
    monkeypatch.setattr("simtune.checking.film.compare._JUDGED_SIZES", (4, 4))
    monkeypatch.setattr("simtune.checking.film.compare.FRAMINGS", FRAMINGS[::4])


@pytest.fixture
def folder(request, tmp_path) -> Path:
    """Has the model SCENE of the test's file, as scene.xml."""
    (tmp_path / "scene.xml").write_text(request.module.SCENE)
    return tmp_path


@pytest.fixture
def load(folder):
    """Loads a tuning file of some text, beside scene.xml."""

    def load(text: str) -> Task:
        (folder / "tune.toml").write_text(text, encoding="utf-8")
        return load_task(str(folder / "tune.toml"))

    return load


@pytest.fixture
def refuses(folder, load):
    """Such a file must end in one clear line that names its place."""

    def refuses(text: str, line: int, message: str) -> None:
        with pytest.raises(InputError) as caught:
            load(text)
        said = str(caught.value)
        assert said.startswith(f"{folder / 'tune.toml'}:{line}: "), said
        assert re.search(message, said), said
        assert "\n" not in said

    return refuses


@pytest.fixture
def controller():
    """A controller on loopback, for the unmodified xArm SDK."""
    try:
        controller = FakeXArm()
    except OSError as error:
        pytest.skip(f"no controller can be played on loopback, port 502: {error}")
    yield controller
    controller.close()


@pytest.fixture
def latch(tmp_path) -> Latch:
    return Latch(tmp_path / "arm.toml.stopped")


@pytest.fixture
def xarm(controller, latch):
    xarm = XArm(controller.ip, acceleration=1000.0, collision_sensitivity=4, latch=latch)
    xarm.connect()
    yield xarm
    xarm.close()


@pytest.fixture
def safe_xarm(xarm, latch):
    """May move."""
    arm = SafeArm(xarm, LIMITS, STEP_S, latch)
    yield arm
    arm.close()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """`make test-all` includes the tests of a GPU where there is one."""
    marked = [item for item in items if item.get_closest_marker("gpu")]
    if marked and not torch.cuda.is_available():
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="needs a CUDA device"))
