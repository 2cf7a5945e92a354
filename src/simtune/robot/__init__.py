"""Robots and cameras: drivers, and what keeps them within limits.

Nothing is imported here: the watchdog's process is of this package, and has to stay small.
"""
