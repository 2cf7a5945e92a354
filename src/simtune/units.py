"""Units of recorded numbers beside the simulator's rad and m."""

import math

# {unit: how many of it are a rad, or a m}; the units' names are those of a tuning file
PER_RAD_OR_M = {"rad": 1.0, "deg": 180 / math.pi, "m": 1.0, "mm": 1000.0}
TURNS = ("rad", "deg")  # units of angles
GAIN_OF_DEGREES = f"{1 / PER_RAD_OR_M['deg']:.6g}"  # rad of a degree, as a tuning file has it
# {unit: how many of another one it has, that one's name, and its key in a tuning file}
OTHER_UNITS = {
    "rad": (PER_RAD_OR_M["deg"], "degrees", "deg"),
    "m": (PER_RAD_OR_M["mm"], "mm", "mm"),
}
OTHER_UNITS |= {f"{unit}/s": its for unit, its in OTHER_UNITS.items()}
