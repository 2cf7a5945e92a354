"""The real world beside the simulator, before and after tuning."""
