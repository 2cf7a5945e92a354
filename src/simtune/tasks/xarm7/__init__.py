"""An xArm 7 in front of a table: code shared by the manipulation tasks, and MJCF scenes."""
