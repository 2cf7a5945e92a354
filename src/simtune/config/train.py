"""The options of `simtune train` and `simtune evaluate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from simtune.config.checks import at_least, check_seed, flag
from simtune.config.prints import Prints
from simtune.config.real import Observes, RealConfig
from simtune.errors import InputError

Method = Literal["autotune", "regression", "dr", "oracle"]
UNTUNED = ("dr", "oracle")  # these search for nothing


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Prints, Observes, RealConfig):
    """Train a policy on pictures, in a simulator that is tuned meanwhile (Algorithm 1).

    Writes result.json, report.html, metrics and videos into OUT. The same command goes on with
    a run that was interrupted, to the same result. In recordings no policy can be tried out: the
    simulator is tuned with those that there are.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file that declares a [policy]."""
    out: Path
    """The run's folder."""
    method: Method = "autotune"
    """autotune: the simulator follows the real world; regression: by the paper's baseline; dr:
    domain randomisation around the start; oracle: in the pseudo-real world itself."""
    preset: Literal["fast", "paper"] = "fast"
    """fast: a teacher that knows the state, and a student on pictures: minutes on two CPU cores;
    paper: SAC on pictures and everything else as the paper has it: a GPU and a day."""
    agent: Literal["teacher_student", "curl_sac", "drqv2"] | None = None
    """By default the preset's: teacher_student or curl_sac."""
    search: Literal["posterior", "paper"] | None = None
    """How autotune moves; by default posterior, with --preset paper the paper's."""
    policy_steps: int | None = None
    """Steps in simulation that the policy learns from; by default the task's."""
    pretrain_steps: int = 0
    """How many of them are by domain randomisation around the start, before the real world is
    filmed; then the policy acts there, not at random (sim-to-real, Sec. VI-B)."""
    drop_far: bool = False
    """When the simulator has moved, forget what the policy did in worlds now out of its range."""
    real_episodes: int | None = None
    """Real episodes to film at first, of random actions or a noisy script, by default 5, with
    --pretrain-steps of the policy; or to take from recordings, by default all, at most 10."""
    tried_episodes: int | None = None
    """Real episodes to film later, each time, of the policy; by default 2, or with --preset paper
    as many as at first."""
    scored_episodes: int = 10
    """Episodes in the pseudo-real world that the policy is scored on; nothing learns from them."""
    range_policy: float = 0.1
    """Half-width, relative to the mean, of the worlds that the policy is trained in (Sec. VI-A)."""
    range_dr: float = 0.5
    """The same for --method dr and --pretrain-steps, around the start (Sec. VI-A: the better of
    0.5 and 1)."""
    range_spm: float = 1.0
    """The same for the worlds that --search paper and regression learn from (Sec. VI-A)."""
    step_size: float = 0.1
    """α of --search paper and regression (authors' code)."""
    window: int = 10
    """Frames that --search paper and regression look at together (Sec. V)."""
    device: str = "auto"
    """Of the policy's networks: auto, cpu, cuda or cuda:N."""

    def check(self) -> None:
        """Raises InputError for what makes no sense."""
        self.check_real()
        at_least(self, 1, "real_episodes", "scored_episodes", "window", "policy_steps")
        at_least(self, 0, "pretrain_steps", "tried_episodes")
        for name in ("range_policy", "range_dr", "range_spm", "step_size"):
            if not 0 < getattr(self, name) <= 1:
                raise InputError(f"{flag(name)} must lie in (0, 1], got {getattr(self, name):g}")
        if self.pretrain_steps and self.method in UNTUNED:
            raise InputError("--pretrain-steps goes with --method autotune or regression")
        if self.method == "oracle" and self.real != "pseudo":
            raise InputError("--method oracle needs --real pseudo: other truths are unknown")
        if self.observe and self.method in UNTUNED:
            raise InputError("--observe goes with --method autotune or regression")
        if self.search and self.method != "autotune":
            raise InputError("--search goes with --method autotune only")


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig(Prints):
    """Score a run once more, on other episodes. Prints one JSON object, and writes nothing.

    Of a run of `train`: its policy, in its pseudo-real world or in any other simulated one. Of a
    run of `tune` with joint readings: --real replays other recordings open loop, each from its
    first readings, in the simulator before and after tuning.
    """

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune train` or `simtune tune` wrote."""
    real: Path | None = None
    """Recordings to replay in the simulator of a run of `tune`."""
    parameters: Path | None = None
    """A JSON object of the world to score in, {name: value}, or a run's result.json; by default the
    pseudo-real world."""
    episodes: int | None = None
    """How many episodes: by default 20, or all of the recordings."""
    seed: int = 1000
    """Of the episodes; the training's own seed repeats those that it was scored on."""

    def check(self) -> None:
        """Raises InputError for numbers that make no sense."""
        at_least(self, 1, "episodes")
        check_seed(self.seed)
