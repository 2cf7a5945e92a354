"""Where a camera is, from a rough guess, when joints are measured: the robot is the target.

find          `simtune check --camera-pose`, top to bottom
scene         the task with a camera that may be elsewhere; the same without the robot
robot         the robot in states that joints tell, as cameras see it
silhouettes   a first guess: where something moves, and where the robot does
edges         where they are and how they run, whatever the colours
align         the robot's edges on the film's
search        both, and known cameras found again, which says how sure that is
written       what is printed, and the table for a tuning file
"""

from simtune.camera_pose.find import find_camera_pose
from simtune.camera_pose.written import lines

__all__ = ["find_camera_pose", "lines"]
