"""Pictures of worlds: two renderers, and what they share."""
