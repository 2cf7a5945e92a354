"""An xArm 7 before a table: what the manipulation tasks share, and their scenes as MJCF files."""
