"""Simulated worlds in batches; each has its own parameters.

    simulator = task.simulator(image_size=64)            # a Simulator: worlds of a MuJoCo model
    rollouts = simulator.roll_out(parameters, actions, rng)       # (n, N) and (n, T, A)
    frames = simulator.film(rollouts)                    # (n, T + 1, H, W, 3) uint8

`play` is the same for actions that depend on the states. An `EnvironmentSimulator` runs a
gymnasium environment; `AnySimulator` is the interface of both, and says where they differ
(`can_start_anywhere`). Renderers draw states, so frames need not be kept: the same states and
parameters give the same frames. `StateSpace` knows the layout of a full state, (S,).

In MuJoCo's terms, n worlds are a `mujoco.batch.Batch`: n rows of full states over one model, of
which `ModelWriter` gives each world its own fields. `observe`, `initialize`, rewards, scripts and
action mappings get that batch. Its pitfalls:

* **A field that was bound late is zero.** A derived field (`xpos`, `sensordata`, ...) is computed
  only from the call after something first read it. So `play` calls `observe` once before it starts
  the worlds; a field first read later needs a `forward` (`tasks.batch_state.computed`).
* **Derived fields may be one substep behind.** After MuJoCo's plain `step` they belong to the state
  before it. `Worlds` steps with stage=mjSTAGE_VEL, which recomputes positions and velocities; later
  stages (accelerations, forces, contact forces) are still of the substep before.
* **Diverged worlds stay in the batch.** They hold NaN or huge values, are stepped no further, and
  only `roll_out` and `Rollouts.finished` leave them out. MuJoCo's silent reset is off.
* **Controls may be late.** Actuators with a delay need room for past controls before the model is
  compiled (`prepare_spec`); the Runge-Kutta integrator shifts them by half a step.
* **Servos have held their first control** when an episode begins (`held_controls`). MuJoCo's own
  delays and filters begin at 0, which would swing a robot there; so would integrated velocities,
  which hold their joints instead.
* **Steps need not divide evenly.** At a recording's rate the timestep is adjusted, and parts of a
  policy step may differ by one substep.
* **A `Simulator` keeps few batches**, by number of worlds: `play` is not reentrant, and other
  numbers allocate anew. Renderers use all cores the process may use.
"""

from simtune.names import RendererName
from simtune.simulation.acting import (
    FrameStacker,
    LiveCamera,
    PixelPolicy,
    acting_late,
    on_pictures,
    scale_actions,
)
from simtune.simulation.actions import (
    ActionMapping,
    DirectActions,
    JointActions,
    MapActions,
    ScaledActions,
)
from simtune.simulation.any_simulator import Act, AnySimulator, Rollouts, random_actions
from simtune.simulation.delays import count_substeps
from simtune.simulation.environment import EnvironmentSimulator, Points
from simtune.simulation.mocap import MocapActions
from simtune.simulation.prepare import prepare_spec
from simtune.simulation.rendering.picture_settings import (
    OPENGL_DM_CONTROL,
    OPENGL_FAST,
    OpenGLQuality,
    PictureSettings,
)
from simtune.simulation.rendering.stray_light import StrayLight
from simtune.simulation.scene import Scene, Script
from simtune.simulation.simulator import Simulator
from simtune.simulation.states import StateSpace

__all__ = [
    "OPENGL_DM_CONTROL",
    "OPENGL_FAST",
    "Act",
    "ActionMapping",
    "AnySimulator",
    "DirectActions",
    "EnvironmentSimulator",
    "FrameStacker",
    "JointActions",
    "LiveCamera",
    "MapActions",
    "MocapActions",
    "OpenGLQuality",
    "PictureSettings",
    "PixelPolicy",
    "Points",
    "RendererName",
    "Rollouts",
    "ScaledActions",
    "Scene",
    "Script",
    "Simulator",
    "StateSpace",
    "StrayLight",
    "acting_late",
    "count_substeps",
    "on_pictures",
    "prepare_spec",
    "random_actions",
    "scale_actions",
]
