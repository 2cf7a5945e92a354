"""A user's own model as a task, declared in TOML (docs/tuning-file.md)."""
