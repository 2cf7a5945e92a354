"""A planar arm of two servos, whose joints are measured: a tuning file of it, and recordings."""

from pathlib import Path

MJCF = """<mujoco>
  <compiler angle="radian"/>
  <option timestep="{timestep_s}" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" range="-2 2" limited="true" armature=".01"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/>
      <body name="lower" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" range="-2 2" limited="true" armature=".01"/>
        <geom type="capsule" fromto="0 0 0 .25 0 0" size=".02" mass=".5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="40" kv="3" ctrlrange="-1 1"/>
    <position name="elbow" joint="elbow" kp="20" kv="1.5" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""

HEAD = """model = "arm.xml"
control_timestep_s = 0.05
episode_steps = 60

[initial_state]
kind = "distribution"
[initial_state.joints]
shoulder = { position = [-0.5, 0.5] }
elbow = { position = [-0.5, 0.5] }

[[sensors]]
name = "encoders"
joints = ["shoulder", "elbow"]
noise = 0.002

"""

SHOULDER = """[[parameters]]
name = "shoulder_kp"
kind = "gain"
objects = "shoulder"

[[parameters]]
name = "shoulder_kv"
kind = "gain_damping"
objects = "shoulder"

"""

ELBOW = """[[parameters]]
name = "elbow_kp"
kind = "gain"
objects = "elbow"

[[parameters]]
name = "elbow_friction"
kind = "friction_loss"
objects = "elbow"
nominal = 0.2
"""

TUNE = HEAD + SHOULDER + ELBOW


def write_arm(folder: Path, tune: str = TUNE, timestep_s: float = 0.01) -> Path:
    """The model and its tuning file; returns the latter."""
    (folder / "arm.xml").write_text(MJCF.format(timestep_s=timestep_s))
    (folder / "tune.toml").write_text(tune)
    return folder / "tune.toml"
