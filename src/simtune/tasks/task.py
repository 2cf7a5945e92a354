"""What a task is: a model, where to look at it, how it starts, what is good, what is tuned."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.footage import Footage
from simtune.observation import JointSensor
from simtune.parameters import ParameterSpace
from simtune.simulation import (
    OPENGL_FAST,
    ActionMapping,
    DirectActions,
    Drawing,
    MapActions,
    OpenGLQuality,
    RendererName,
    Scene,
    Script,
    Simulator,
    prepare_spec,
)
from simtune.views import View

_SIZES = ("nbuffer", "signature")  # of an MjModel, which grow with the paths of its files


def content_hash(*parts: bytes | str) -> str:
    """Short hexadecimal digits by which a run notices that any of the parts is another one."""
    digest = sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()[:16]


def _content(part: object) -> Iterator[bytes]:
    """All numbers and names of an MjModel, but not where its files lie."""
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
    """A simulated task; each of the built-in ones is a file of this folder."""

    name: str
    description: str
    load_spec: Callable[[], mujoco.MjSpec]  # the nominal model, editable: what is exported
    parameters: ParameterSpace
    cameras: tuple[Footage, ...]  # what films, and how; none: only sensors measure
    sensors: tuple[JointSensor, ...] = ()  # what is measured beside pictures, if recordings have it
    # Of cameras and sensors, what is looked at unless other names are asked for; None: all of it
    looks_at: tuple[str, ...] | None = None
    control_timestep_s: float  # an action is held for action_repeat of these
    action_repeat: int
    episode_steps: int = 200  # policy steps
    policy_steps: int = 100_000  # in simulation, after which the fast preset has learnt to act
    # Starts every simulation of the batch anew, whose parameters are written already.
    initialize: Callable[[Batch, np.random.Generator], None]
    map_actions: MapActions = DirectActions  # what actions do, made for a model
    action_columns: tuple[str, ...] | None = None  # of recordings, by name; None: all they have
    # (nsim,) reward of the batch's present state, after step(stage=mjSTAGE_VEL), which is one
    # control timestep; a policy step's reward is the sum over its action_repeat of them.
    # Tuning looks at no reward: None where no policy is to be trained.
    reward: Callable[[Batch], np.ndarray] | None = None
    # (nsim,) bool of the batch's present state: done, and nearly so; None where undeclared.
    success: Callable[[Batch], np.ndarray] | None = None
    near_success: Callable[[Batch], np.ndarray] | None = None
    # Acts well by what only a simulator knows: explores what random actions seldom touch.
    script: Script | None = None
    # Joints whose position makes no difference, such as how far a robot went:
    # `rollout.Environment.observe` drops it.
    free_joints: tuple[str, ...] = ()
    # {hinge: n}: after an nth of a turn everything looks and moves the same, so that no picture
    # tells one from the other; `Environment.observe` does not either.
    symmetric_hinges: Mapping[str, int] = field(default_factory=dict)
    # {parameter: value} of colours that are known: by them a camera's gains are found
    known_colours: Mapping[str, float] = field(default_factory=dict)
    declared: str = ""  # what a tuning file says of it
    declared_policy: str = ""  # ... of what is good, which no search looks at
    source: str = ""  # by which `load_any_task` finds it again, from any folder
    files: tuple[Path, ...] = ()  # absolute: all that it was read from

    @cached_property  # the model is compiled for it
    def content_hash(self) -> str:
        """Another one after a change of the model, or of what is declared of it."""
        model = b"".join(_content(self.load_model()))
        return content_hash(model, self.declared, repr(list(self.parameters)))

    @property
    def policy_hash(self) -> str | None:
        """The same of what a policy is trained for; None: nothing is declared of it."""
        return content_hash(self.declared_policy) if self.declared_policy else None

    @property
    def goals(self) -> dict[str, Callable[[Batch], np.ndarray]]:
        """What an episode can have reached at its end, by the names that results have."""
        named = {"success": self.success, "near_success": self.near_success}
        return {name: goal for name, goal in named.items() if goal}

    def load_model(self, step_s: float | None = None) -> mujoco.MjModel:
        """The nominal model, compiled anew; see `spec_for`."""
        return self.spec_for(step_s).compile()

    def spec_for(self, step_s: float | None = None) -> mujoco.MjSpec:
        """The nominal model, editable, for actions of `step_s` s, by default a policy step.

        Its actuators have what is needed for their parameters: see `prepare_spec`.
        """
        spec = self.load_spec()
        prepare_spec(spec, self.parameters, step_s or self.step_s)
        return spec

    def load_actions(self) -> ActionMapping:
        """What actions do in the nominal model."""
        return self.map_actions(self.load_model())

    @property
    def step_s(self) -> float:
        """Seconds of one policy step."""
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
    ) -> Simulator:
        """Worlds of this task; an action lasts `step_s` seconds, by default a policy step.

        Pictures are `image_size` pixels high, of `views` or else of squares by all its cameras.
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
        drawing = Drawing(
            image_size=image_size,
            renderer=renderer,
            quality=quality,
            supersampling=supersampling,
            views=tuple(views),
        )
        return Simulator(scene, drawing)
