"""The run folder: configuration, logs, and checkpoints for resuming."""
