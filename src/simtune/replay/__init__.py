"""Stored simulated episodes, with each frame once: agents read transitions, an SPM windows."""

from simtune.replay.episodes import Episodes
from simtune.replay.replay import Replay, Transitions, in_parts
from simtune.replay.store import EpisodeStore

__all__ = ["EpisodeStore", "Episodes", "Replay", "Transitions", "in_parts"]
