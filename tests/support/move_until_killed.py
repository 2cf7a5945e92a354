"""Run by test_xarm.py to be killed: moves an xArm back and forth. Arguments: IP LATCH"""

import itertools
import sys
from pathlib import Path

import numpy as np

from simtune.robot.latch import Latch
from simtune.robot.limits import Limits
from simtune.robot.safe_arm import SafeArm
from simtune.robot.xarm import XArm

low, high = np.array([200.0, -200.0, 100.0]), np.array([500.0, 200.0, 400.0])
latch = Latch(Path(sys.argv[2]))
robot = XArm(sys.argv[1], acceleration=1000.0, collision_sensitivity=3, latch=latch)
robot.connect()
limits = Limits(low=low, high=high, speed=100.0, tolerance=5.0)
arm = SafeArm(robot, limits, 0.3, latch)
print("moving", flush=True)
for place in itertools.cycle([np.array([250.0, -50.0, 150.0]), np.array([450.0, 100.0, 350.0])]):
    arm.go_to(place)
