"""`simtune evaluate`: a run's policy once more, or other recordings in its simulator."""
