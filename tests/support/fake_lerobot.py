"""A robot with LeRobot's interface: it is at once where it is sent, and films a grey picture."""

import numpy as np


class FakeRobot:
    """One of its two axes ends before its workspace does, as real ones may."""

    def __init__(self):
        self.action_features = {"pan.pos": float, "lift.pos": float}
        self.observation_features = {**self.action_features, "front": (48, 64, 3)}
        self.place = {"pan.pos": 0.0, "lift.pos": 20.0}
        self.sent: list[dict[str, float]] = []
        self.is_connected = False
        self.fails_at: int | None = None  # the action that it fails at

    def connect(self):
        self.is_connected = True

    def disconnect(self):
        self.is_connected = False

    def get_observation(self):
        assert self.is_connected
        shade = np.uint8(128 + np.nan_to_num(self.place["pan.pos"]))
        return {**self.place, "front": np.full((48, 64, 3), shade)}

    def send_action(self, action):
        if len(self.sent) == self.fails_at:
            raise ConnectionError("the bus is silent")
        self.sent.append(action)
        self.place = {**action, "lift.pos": min(action["lift.pos"], 30.0)}
        return self.place


latest: list[FakeRobot] = []


def make():
    latest.append(FakeRobot())
    return latest[-1]
