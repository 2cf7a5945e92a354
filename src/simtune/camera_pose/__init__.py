"""Where a camera is, from a rough guess, when joints are measured: the robot is the target.

find          `simtune check --camera-pose`, top to bottom
scene         the task with a camera that may be elsewhere; what moves before it
geometry      the camera: its pose, what it projects, and derivatives
robot         the robot in states that joints tell: its outlines, and points on it
film          the film's edges, of what moves and of what stands still
silhouettes   a first guess: where something moves, and where the robot does
tracking      the robot's outlines on the film's edges
search        that, from several starts
sureness      how wrong it may be
written       what is printed, and the table for a tuning file
"""

from simtune.camera_pose.find import find_camera_pose
from simtune.camera_pose.written import lines

__all__ = ["find_camera_pose", "lines"]
