"""How far a fit can be trusted: fits of known worlds, and what they say about it."""
