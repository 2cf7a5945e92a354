"""What a run looked at, and what it searched for."""

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from simtune.errors import InputError
from simtune.names import search_traits
from simtune.run_data.facts import RunFacts
from simtune.validate import is_number

if TYPE_CHECKING:
    from simtune.tasks import AnyTask  # and MuJoCo, a second that who only compares runs saves


@dataclass(frozen=True, kw_only=True)
class RunData(RunFacts):
    """The content of a run folder, with what it says about the parameters that were looked at."""

    @property
    def looked_at(self) -> dict[str, dict[str, Any]]:
        """`parameters` without those of `not_looked_at`."""
        left_out = set(self.not_looked_at)
        return {name: facts for name, facts in self.parameters.items() if name not in left_out}

    @property
    def not_looked_at(self) -> list[str]:
        """Names of parameters that show in pictures only, of a run that used none."""
        if self.has_pictures:
            return []
        if checked := self.object("check"):
            return [name for name in self.parameters if _shows_in_pictures_only(checked.get(name))]
        space = self._task.parameters if self._task else ()
        return [p.name for p in space if p.is_appearance and p.name in self.parameters]

    @property
    def searched(self) -> dict[str, dict[str, Any]]:
        """`looked_at` without what is known."""
        return {name: facts for name, facts in self.looked_at.items() if name not in self.known}

    @cached_property
    def known(self) -> frozenset[str]:
        """Parameters of known colours, which a search that takes them leaves as they are.

        Empty if the task is not there.
        """
        from simtune.tasks import Task, with_known_colours

        is_used = self.colours and search_traits(self.search).takes_known_colours
        task = self._task if is_used else None
        if not isinstance(task, Task):
            return frozenset()
        with suppress(InputError):
            task = with_known_colours(task, self.config.get("known_colour"))
        return frozenset(task.known_colours)

    @property
    def has_known_colours(self) -> bool:
        """Whether an option or the tuning file declares a colour as known, as far as known."""
        return bool(self.config.get("known_colour") or self.known)

    @property
    def colours(self) -> list[str]:
        """Names NAME for which NAME_r, NAME_g and NAME_b are all parameters."""
        channels = [name for name, facts in self.parameters.items() if _is_of_colour(facts)]
        names = (channel[:-2] for channel in channels if channel.endswith("_r"))
        return [name for name in names if {f"{name}_g", f"{name}_b"} <= set(channels)]

    def is_colour(self, name: str) -> bool:
        return name[:-2] in self.colours and name[-2:] in ("_r", "_g", "_b")

    @cached_property
    def _task(self) -> "AnyTask | None":
        """The tuned task; None if it cannot be read any more."""
        with suppress(InputError):
            return self.load_task() if self.config.get("task") else None


def _shows_in_pictures_only(checked: object) -> bool:
    """Whether `check` lists no std for a parameter, as it does for appearance alone."""
    return isinstance(checked, dict) and not {"std", "std_percent"} & checked.keys()


def _is_of_colour(facts: dict[str, Any]) -> bool:
    """Whether a parameter's values may be a colour's: a name ending in _r is not enough."""
    known = (facts.get(key) for key in ("nominal", "initial", "mean", "low", "high", "real"))
    return all(0 <= value <= 1 for value in known if is_number(value))
