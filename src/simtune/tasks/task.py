"""A task: a model, its cameras and sensors, initial states, reward, and the tuned parameters."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.cameras.footage import Footage
from simtune.cameras.views import View
from simtune.columns import counted
from simtune.observation import JointSensor
from simtune.parameters import ParameterSpace
from simtune.simulation import (
    OPENGL_FAST,
    ActionMapping,
    DirectActions,
    MapActions,
    OpenGLQuality,
    PictureSettings,
    RendererName,
    Scene,
    Script,
    Simulator,
    prepare_spec,
)

MOST_STEPS = 100_000  # of an episode, as of a recorded one
_SIZES = ("nbuffer", "signature")  # of an MjModel; they depend on the lengths of its file paths


def content_hash(*parts: bytes | str) -> str:
    """16 hexadecimal digits; a run compares them to notice that a part has changed."""
    digest = sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()[:16]


def in_a_line(
    name: str,
    parameters: ParameterSpace,
    observed: Sequence[Footage | JointSensor],
    step_s: float,
) -> str:
    """What a task is, for who types its name in Python."""
    kinds = {Footage: "camera", JointSensor: "sensor"}
    seen = [f"{kinds[type(part)]} {part.name}" for part in observed]
    what = [counted(len(parameters), "parameter"), *seen, f"{step_s:.4g} s a step"]
    return f"<Task {name}: {', '.join(what)}>"


def _content(part: object) -> Iterator[bytes]:
    """All numbers and names of an MjModel, except the paths of its files."""
    for name in sorted(dir(part)):
        if name.startswith("_") or name.endswith(("paths", "pathadr")) or name in _SIZES:
            continue
        value = getattr(part, name)
        if isinstance(value, np.ndarray):
            yield name.encode() + value.tobytes()
        elif isinstance(value, int | float | bytes | str):
            yield f"{name}{value!r}".encode()
        elif not callable(value):  # options, statistics, visual settings and their parts
            yield from _content(value)


@dataclass(frozen=True, kw_only=True)
class Task:
    """A simulated task; each built-in task is a file of this folder."""

    name: str
    description: str
    load_spec: Callable[[], mujoco.MjSpec]  # the nominal model, editable; used for the export
    parameters: ParameterSpace
    cameras: tuple[Footage, ...]  # cameras and their recordings; empty: sensors only
    sensors: tuple[JointSensor, ...] = ()  # measurements beside pictures, if recordings have them
    # Names of the cameras and sensors used by default; None: all
    looks_at: tuple[str, ...] | None = None
    control_timestep_s: float
    action_repeat: int  # number of control timesteps for which an action is held
    episode_steps: int = 200  # policy steps
    policy_steps: int = 100_000  # in simulation; enough for the fast preset to learn the task
    # Sets the initial state of every simulation of the batch; parameters are written before
    initialize: Callable[[Batch, np.random.Generator], None]
    map_actions: MapActions = DirectActions  # makes the meaning of actions for a model
    action_columns: tuple[str, ...] | None = None  # names in recordings; None: all columns
    # (nsim,) reward of the batch's current state, after step(stage=mjSTAGE_VEL), for one control
    # timestep; a policy step's reward is the sum over action_repeat of them. Tuning uses no reward,
    # so None is enough if no policy is trained.
    reward: Callable[[Batch], np.ndarray] | None = None
    # (nsim,) bool for the batch's current state: success, and near success; None: undeclared
    success: Callable[[Batch], np.ndarray] | None = None
    near_success: Callable[[Batch], np.ndarray] | None = None
    # Policy steps within which a goal is to be reached, and kept until the episode's end; None: it
    # counts if it is reached at the end
    goal_steps: int | None = None
    # Acts well with the simulator's state: explores contacts that random actions seldom reach
    script: Script | None = None
    # Joints whose position makes no difference, such as the distance a robot has gone;
    # policies learn without these positions
    free_joints: tuple[str, ...] = ()
    # {hinge: n}: everything looks and moves the same after 1/n of a turn, so pictures cannot
    # distinguish the angles; nor do the states that policies learn from
    symmetric_hinges: Mapping[str, int] = field(default_factory=dict)
    # {parameter: value} of known colours, from which a camera's gains are estimated
    known_colours: Mapping[str, float] = field(default_factory=dict)
    declared: str = ""  # content of the tuning file
    declared_policy: str = ""  # its part about reward and success, which no search uses
    source: str = ""  # name by which `load_any_task` finds the task again, from any folder
    files: tuple[Path, ...] = ()  # absolute paths of all files it was read from

    def __repr__(self) -> str:
        return in_a_line(self.name, self.parameters, (*self.cameras, *self.sensors), self.step_s)

    @cached_property
    def content_hash(self) -> str:
        """Hash of the model and of the tuning file's content; it changes if one of them does."""
        model = b"".join(_content(self.nominal_model))
        return content_hash(model, self.declared, repr(list(self.parameters)))

    @property
    def policy_hash(self) -> str | None:
        """Hash of the declared reward and success; None: none is declared."""
        return content_hash(self.declared_policy) if self.declared_policy else None

    @property
    def goals(self) -> dict[str, Callable[[Batch], np.ndarray]]:
        """{name in results: function} of the goals that an episode may reach."""
        named = {"success": self.success, "near_success": self.near_success}
        return {name: goal for name, goal in named.items() if goal}

    @cached_property
    def nominal_model(self) -> mujoco.MjModel:
        """To look at: it is compiled once, so nobody may change it."""
        return self.load_model()

    def load_model(self, step_s: float | None = None) -> mujoco.MjModel:
        """The nominal model, compiled anew; see `spec_for`."""
        return self.spec_for(step_s).compile()

    def spec_for(self, step_s: float | None = None) -> mujoco.MjSpec:
        """The nominal model, editable, for actions of `step_s` s, by default a policy step.

        It is prepared for its parameters; see `prepare_spec`.
        """
        spec = self.load_spec()
        prepare_spec(spec, self.parameters, step_s or self.step_s)
        return spec

    def load_actions(self) -> ActionMapping:
        """The meaning of actions in the nominal model."""
        return self.map_actions(self.nominal_model)

    @property
    def step_s(self) -> float:
        """Duration of one policy step."""
        return self.control_timestep_s * self.action_repeat

    def simulator(
        self,
        *,
        image_size: int,
        step_s: float | None = None,
        renderer: RendererName = "raycaster",
        quality: OpenGLQuality = OPENGL_FAST,
        supersampling: int = 1,
        views: Sequence[View] | None = None,
        device: str = "cpu",
    ) -> Simulator:
        """A simulator of this task; an action lasts `step_s` seconds, by default a policy step.

        Pictures are `image_size` pixels high and show `views`, by default a square per camera.
        The ray caster draws them on `device`: cpu, cuda or cuda:N.
        """
        if views is None:
            views = [View(footage.camera) for footage in self.cameras]
        scene = Scene(
            model=self.load_model(step_s),
            space=self.parameters,
            step_s=step_s or self.step_s,
            initialize=self.initialize,
            map_actions=self.map_actions,
            script=self.script,
        )
        pictures = PictureSettings(
            image_size=image_size,
            renderer=renderer,
            quality=quality,
            supersampling=supersampling,
            views=tuple(views),
            device=device,
        )
        return Simulator(scene, pictures)
