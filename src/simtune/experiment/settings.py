"""Settings for callers from Python, without an option on the command line."""

from collections.abc import Callable
from dataclasses import dataclass, field

from simtune.agents import Agent, AgentSpec, make_agent
from simtune.before_after.start_search import StartSearchConfig
from simtune.experiment.schedule import Schedule
from simtune.experiment.search_settings import SearchSettings
from simtune.names import AgentName


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Those of None are the preset's. They are not stored: resume a run with the same ones."""

    search: SearchSettings | None = None  # of the search that the options select
    start_search: StartSearchConfig = field(default_factory=StartSearchConfig)
    # For `train` only
    schedule: Schedule | None = None
    make_agent: Callable[[AgentName, AgentSpec], Agent] = make_agent
    checkpoint_every_s: float = 60.0  # in policy training; other phases save at their end
