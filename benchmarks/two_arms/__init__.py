"""What aloha.py is made of: a world and its recordings, and `mujoco.sysid` on its readings."""
