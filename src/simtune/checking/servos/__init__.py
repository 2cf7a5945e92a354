"""How joints follow their commands: a servo's gain, lag and play, and what looks wrong."""
