"""What no option of the command line asks, and callers from Python may choose."""

from collections.abc import Callable
from dataclasses import dataclass, field

from simtune.agents import Agent, AgentSpec, make_agent
from simtune.comparison import StartSearchConfig
from simtune.schedule import Schedule
from simtune.tuning import SearchSettings


@dataclass(frozen=True, kw_only=True)
class Settings:
    """None: as the preset has it. They are not stored: a run goes on with the same ones only."""

    search: SearchSettings | None = None  # of the search that the options ask for
    comparison: StartSearchConfig = field(default_factory=StartSearchConfig)
    # Of `train` alone
    schedule: Schedule | None = None
    make_agent: Callable[[str, AgentSpec], Agent] = make_agent
    checkpoint_every_s: float = 60.0  # of policy training; other phases save at their end
