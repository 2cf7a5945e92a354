"""`tune` from pixels to numbers: a mass and a colour of a small scene, found and bracketed."""

import math
from pathlib import Path

import pytest

from simtune.before_after.start_search import StartSearchConfig
from simtune.config import TuneConfig
from simtune.experiment.settings import Settings
from simtune.fit import FitConfig
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.search_param_model.posterior import PosteriorConfig
from simtune.search_param_model.posterior_net import PosteriorNetConfig
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning_run import tune
from simtune.vision.detector import DetectorConfig

SCENE = """
<mujoco>
  <option timestep="0.01"/>
  <visual><headlight ambient="0.5 0.5 0.5" diffuse="0.4 0.4 0.4" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="front" pos="0 -2.2 0" xyaxes="1 0 0 0 0 1" fovy="45"/>
    <geom name="wall" type="plane" size="3 3 .1" pos="0 0.5 0" zaxis="0 -1 0" rgba=".2 .25 .3 1"/>
    <body name="bob">
      <joint name="hinge" axis="0 1 0" damping="0.3"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -.6" size=".04" mass=".01"
            rgba=".9 .9 .9 1"/>
      <geom name="ball" type="sphere" pos="0 0 -.6" size=".14" mass="0.5" rgba=".8 .3 .2 1"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge" gear="3" ctrlrange="-1 1"/></actuator>
</mujoco>
"""

TUNING_FILE = """
model = "scene.xml"
name = "motor_pendulum"
camera = "front"
control_timestep_s = 0.05
episode_steps = 60
description = "a pendulum that a motor drives"

[initial_state]
kind = "distribution"

[initial_state.joints]
hinge = { position = [-0.5, 0.5], velocity = [-1.0, 1.0] }

[[parameters]]
name = "mass"
kind = "mass"
objects = "bob"

[[parameters]]
name = "ball"
kind = "colour"
objects = "ball"
"""

# Updates end each training, and not the time: so a seed gives the same on any machine.
SEARCH = PosteriorSearchConfig(
    model=PosteriorConfig(
        detector=DetectorConfig(channels=8, free_maps=4, hidden=64, batch_size=32),
        posterior_net=PosteriorNetConfig(channels=32, hidden=64, candidates=32),
    ),
    num_worlds=48,
    episodes_per_world=2,
    pictures_per_world=12,
    held_out_worlds=24,
    held_out_steps=24,
    near_worlds=12,
    near_steps=16,
    num_rounds=2,
    detector_updates=(180, 100),
    posterior_updates=60,
    state_updates=50,
    planned_refits=2,
    most_refits=2,
    fit=FitConfig(
        num_particles=64,
        shooting=ShootingConfig(
            stages=(Stage(4, 4, 6.0, states_only=True), Stage(8, 2, 2.0), Stage(12, 4)),
            longer=(),
            num_windows=20,
        ),
    ),
)
SETTINGS = Settings(search=SEARCH, start_search=StartSearchConfig(num_starts=16, rounds=1))
WITHIN_PERCENT = 5.0


@pytest.mark.thorough
def test_tune_recovers_a_mass_and_a_colour_from_pixels(tmp_path: Path):
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "tune.toml").write_text(TUNING_FILE)
    config = TuneConfig(
        task=str(tmp_path / "tune.toml"),
        out=tmp_path / "run",
        real_episodes=3,
        image_size=32,
        budget_minutes=math.inf,
        seed=0,
    )
    result = tune(config, settings=SETTINGS)
    found = result["parameters"]
    assert set(found) == {"mass", "ball_r", "ball_g", "ball_b"}
    for name, entry in found.items():
        begun = abs(entry["initial"] - entry["real"]) / entry["real"]
        assert begun > 0.2, "it begins with twice or half of it, or a colour's most"
        assert entry["percent_error"] < WITHIN_PERCENT, (name, entry)
        reach = (entry["high"] - entry["low"]) / 2
        # One interval of ten may miss, and arithmetic differs between machines, but not by far:
        # whether nine of ten hold is for benchmarks/whole_runs.py to say.
        assert abs(entry["mean"] - entry["real"]) < 2.5 * reach, (name, entry)
