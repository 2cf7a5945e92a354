"""Stored simulated episodes, with each frame once: agents read transitions, an SPM windows."""

from simtune.replay_buffer.buffer import ReplayBuffer, Transitions, in_parts
from simtune.replay_buffer.episodes import Episodes
from simtune.replay_buffer.store import EpisodeStore

__all__ = ["EpisodeStore", "Episodes", "ReplayBuffer", "Transitions", "in_parts"]
