"""Finds a camera's pose from a rough guess, with measured joints: the robot is the target.

find          `simtune check --camera-pose`, top to bottom
scene         the task with a camera anywhere; what moves before it
geometry      the camera: its pose and projection
robot         the robot in measured states: its outlines, and points on it
edges         the film's edges, of moving things and of the background
silhouettes   a first guess: where something moves, and where the robot does
tracking      aligns the robot's outlines with the film's edges
search        tracking from several starts
bending       a camera behind a lens that bends straight lines by one more unknown
lens_check    whether the film looks as if through another lens than declared
found         a camera that was found
sureness      uncertainty of the result
written       output, and the table for a tuning file
"""

from simtune.camera_pose.find import find_camera_pose
from simtune.camera_pose.written import lines

__all__ = ["find_camera_pose", "lines"]
