"""Searches: how Ξ moves towards the real system."""
