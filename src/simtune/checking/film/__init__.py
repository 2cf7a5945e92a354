"""Whether a film shows the simulator's scene: likeness, framing, and a picture of both."""
