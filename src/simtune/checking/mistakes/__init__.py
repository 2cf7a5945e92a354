"""Mistakes in recordings of joints that no servo moves."""
