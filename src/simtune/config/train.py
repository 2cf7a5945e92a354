"""The options of `simtune train`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from simtune.config.option_checks import at_least, check_known_colour, flag, usual_without
from simtune.config.prints import Prints
from simtune.config.real import NO_RECORDINGS, RealConfig
from simtune.errors import InputError
from simtune.names import DEFAULT_SEARCH, AgentName, search_traits

Method = Literal["autotune", "regression", "dr", "untuned", "oracle"]
UNTUNED = ("dr", "untuned", "oracle")  # methods without a search


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Prints, RealConfig):
    """Train a policy on pictures, in a simulator that is tuned meanwhile (Algorithm 1).

    Writes result.json, report.html, metrics and videos into OUT. The same command continues an
    interrupted run, to the same result. A policy cannot be tried in recordings: the simulator is
    tuned with the given ones only.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file that declares a [policy]."""
    out: Path
    """The run's folder."""
    method: Method = "autotune"
    """autotune: the simulator follows the real world; regression: likewise, by the paper's
    baseline; dr: domain randomisation around the start; untuned: in the simulator as it starts;
    oracle: in the pseudo-real world itself."""
    preset: Literal["fast", "paper"] = "fast"
    """fast: a teacher that knows the state, and a student on pictures: minutes on two CPU cores;
    paper: SAC on pictures, and everything else as in the paper: a GPU and a day."""
    agent: AgentName | None = None
    """How the policy learns: teacher_student, the default; curl_sac, the paper's SAC on pictures,
    and the default with --preset paper."""
    search: Literal["posterior", "paper"] | None = None
    """How autotune searches; by default posterior, with --preset paper the paper's search."""
    policy_steps: int | None = None
    """Simulated steps that the policy learns from; by default the task's number, with --preset
    paper 500,000."""
    pretrain_steps: int = 0
    """How many of these steps use domain randomisation around the start, before the real world is
    filmed; then the policy acts there instead of random actions (sim-to-real, Sec. VI-B)."""
    real_episodes: int | None = None
    """Real episodes to film at first, by default 5, with random actions, a noisy script or, with
    --pretrain-steps, the policy; or to read from recordings, by default all, at most 10."""
    tried_episodes: int | None = None
    """Real episodes of the policy to film after each update; by default 2, with --preset paper as
    many as at first."""
    scored_episodes: int = 10
    """Episodes in the pseudo-real world for scoring the policy; nothing is learnt from them."""
    range_policy: float = 0.1
    """Half-width, relative to the mean, of the range of worlds that the policy is trained in (Sec.
    VI-A); identified parameters are drawn from twice their interval, but at least from a fifth of
    this range."""
    range_dr: float = 0.5
    """Half-width of that range for --method dr and --pretrain-steps, around the start (Sec. VI-A:
    the better of 0.5 and 1)."""
    range_spm: float = 1.0
    """Half-width of the range of worlds that --search paper and regression learn from (Sec.
    VI-A)."""
    step_size: float = 0.1
    """α of --search paper and regression (authors' code)."""
    window: int = 10
    """Number of frames that --search paper and regression use together (Sec. V)."""

    @property
    def has_search(self) -> bool:
        return self.method not in UNTUNED

    def check(self) -> None:
        """Raises InputError for invalid options."""
        self.check_real()
        at_least(self, 1, "real_episodes", "scored_episodes", "window", "policy_steps")
        at_least(self, 0, "pretrain_steps", "tried_episodes")
        for name in ("range_policy", "range_dr", "range_spm", "step_size"):
            if not 0 < getattr(self, name) <= 1:
                raise InputError(f"{flag(name)} must lie in (0, 1], got {getattr(self, name):g}")
        if self.pretrain_steps and not self.has_search:
            raise InputError("--pretrain-steps goes with --method autotune or regression")
        if self.method == "oracle" and self.real != "pseudo":
            raise InputError("--method oracle needs --real pseudo: other truths are unknown")
        if self.observe and not self.has_search:
            raise InputError("--observe goes with --method autotune or regression")
        if self.search and self.method != "autotune":
            raise InputError("--search goes with --method autotune only")
        self._check_ignored()

    def _check_ignored(self) -> None:
        """Raises InputError for options that the method, its search or the real world ignore."""
        search = self.search or ("paper" if self.preset == "paper" else DEFAULT_SEARCH)
        search = search if self.method == "autotune" else self.method
        if not search_traits(search).takes_small_steps:
            own = ("range_spm", "step_size", "window")
            usual_without(self, "--search paper or --method regression", *own)
        check_known_colour(self.known_colour, search)
        if not self.has_search:
            own = ("real_episodes", "tried_episodes", "range_policy")
            usual_without(self, "--method autotune or regression", *own)
        if self.method != "dr" and not self.pretrain_steps:
            usual_without(self, "--method dr or --pretrain-steps", "range_dr")
        if self.real != "pseudo":
            usual_without(self, "--real pseudo only", "scored_episodes")
        if self.real not in NO_RECORDINGS:
            usual_without(self, "--real pseudo or a robot", "tried_episodes")
