"""What all tests share."""

from dataclasses import replace
from functools import partial

import pytest
import torch
from fake_xarm import FakeXArm
from robot_limits import LIMITS, STEP_S
from tiny_search import TINY_SEARCH

from simtune.agents.teacher_student import TeacherStudent, TeacherStudentConfig
from simtune.robot.latch import Latch
from simtune.robot.safe_arm import SafeArm
from simtune.robot.xarm import XArm
from simtune.simulation import make_renderer
from simtune.tasks import load_any_task
from simtune.tuning.posterior_config import PosteriorSearchConfig


@pytest.fixture(autouse=True, scope="session")
def _one_torch_thread():
    """The networks here are tiny: threads would only wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def tiny() -> PosteriorSearchConfig:
    """A posterior search that takes seconds and finds nothing."""
    return TINY_SEARCH


@pytest.fixture(scope="session")
def one_renderer_each():
    """Renderers by what they draw: each takes a second to make, and none keeps anything."""
    renderers = {}

    def make_once(name, model, space, camera, image_size, *rest):
        key = (name, model.names, space.names, camera, image_size, *rest)
        if key not in renderers:
            renderers[key] = make_renderer(name, model, space, camera, image_size, *rest)
        return renderers[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("simtune.simulation.simulator.make_renderer", make_once)
        yield


@pytest.fixture
def quick_tune(monkeypatch, tiny, one_renderer_each):
    """Makes `tune` take seconds, and find nothing."""

    def load_short_task(name: str):
        return replace(load_any_task(name), episode_steps=24)

    monkeypatch.setattr("simtune.tune.load_any_task", load_short_task)
    monkeypatch.setattr("simtune.tuning.posterior.PosteriorSearchConfig", lambda: tiny)
    monkeypatch.setattr("simtune.parts.load_task", load_short_task)
    monkeypatch.setattr("simtune.presets._SHORTER", tiny)
    # Of so few steps
    early = TeacherStudentConfig(teacher_share=0.2, random_steps=24, trusting_share=0.05)
    monkeypatch.setattr("simtune.agents.TeacherStudent", partial(TeacherStudent, config=early))
    monkeypatch.setattr("simtune.comparison._NUM_STARTS", 16)
    monkeypatch.setattr("simtune.comparison._ROUNDS", 2)


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
