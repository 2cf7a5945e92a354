"""A task with a gymnasium environment instead of a MuJoCo model; it can be tuned."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from simtune.cameras.footage import Footage
from simtune.cameras.views import View
from simtune.errors import InputError
from simtune.parameters import ParameterSpace
from simtune.simulation import EnvironmentSimulator
from simtune.simulation.user_environment import BoxActions, blame_environment
from simtune.tasks.task import content_hash, in_a_line

_SLACK = 0.01  # relative difference allowed between the recordings' step and the environment's


@dataclass(frozen=True, kw_only=True)
class EnvironmentTask:
    """Counterpart of `Task`; `simulation.user_environment` says what `make` must return."""

    name: str
    description: str
    make: Callable[[], Any]  # returns a gymnasium.Env or an object that acts like one
    parameters: ParameterSpace
    step_s: float  # time that env.step simulates
    episode_steps: int
    # Its pictures are cut to their middle square, and so is a film
    cameras: tuple[Footage, ...] = (Footage(camera="render", name="render", is_square=True),)
    declared: str = ""  # content of the tuning file and of the environment's code
    source: str = ""  # see `Task`
    files: tuple[Path, ...] = ()  # see `Task`

    def __repr__(self) -> str:
        return in_a_line(self.name, self.parameters, self.cameras, self.step_s)

    @property
    def content_hash(self) -> str:
        """Hash of the declaration; it changes if the declaration does."""
        return content_hash(self.declared, repr(list(self.parameters)))

    @cached_property
    def _env(self) -> Any:
        with blame_environment(f"{self.name}: the environment cannot be made"):
            env = self.make()
        for needed in ("action_space", "reset", "step", "render"):
            if not hasattr(env, needed):
                raise InputError(
                    f"{self.name}: expected a gymnasium.Env, got one without {needed}: {env!r:.60}"
                )
        return env

    def load_actions(self) -> BoxActions:
        """The environment's actions."""
        return BoxActions(self._env.action_space)

    def simulator(
        self,
        *,
        image_size: int,
        step_s: float | None = None,
        supersampling: int = 1,
        views: Sequence[View] | None = None,
        device: str = "cpu",
    ) -> EnvironmentSimulator:
        """A simulator of the environment; see `Task.simulator`.

        The environment itself decides how smoothly it draws, and pictures are square: the arguments
        `supersampling`, `views` and `device` are ignored. Raises InputError if recordings have
        another rate than the environment, or if the environment does not say where things are in
        the picture, so that motion could not be seen.
        """
        if step_s and abs(step_s / self.step_s - 1) > _SLACK:
            raise InputError(
                f"{self.name} makes steps of {self.step_s:g} s, the recordings have one every "
                f"{step_s:g} s; record at the environment's rate, or have it step as they do"
            )
        simulator = EnvironmentSimulator(
            self._env, self.parameters, step_s=self.step_s, image_size=image_size
        )
        hidden = [p.name for p in self.parameters if not p.is_visible]
        if hidden and not len(simulator.points()):
            raise InputError(
                f"{hidden[0]} shows in motion only, and {self.name} does not say where things are: "
                'have reset() and step() give info["points"] (docs/tuning-file.md)'
            )
        return simulator
