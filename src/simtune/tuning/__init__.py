"""Searches: how Ξ is moved towards the real world."""
