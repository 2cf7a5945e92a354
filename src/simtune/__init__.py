"""Tune a simulator's parameters until it matches the video of a real robot."""

__version__ = "0.1.0"
