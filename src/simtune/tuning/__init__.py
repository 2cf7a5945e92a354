"""Searches: how Ξ is moved towards the real world. `make_search` has them by name."""
