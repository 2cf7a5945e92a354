"""Robots and cameras: drivers and safety limits.

Nothing is imported here, since the watchdog's process, which is in this package, must stay small.
"""
