"""Detections of remembered episodes: new ones at once, old ones in turn."""

import torch

from simtune.agents.recollection import Recollection


class Detector:
    """Tells how often it was asked before."""

    def __init__(self):
        self.asked = 0

    def __call__(self, _: int) -> torch.Tensor:
        self.asked += 1
        return torch.full((3, 2), float(self.asked))


def test_new_episodes_are_looked_at_and_of_the_others_the_oldest_detections_are_renewed():
    recollection, detect = Recollection(num_renewed=1), Detector()
    seen = recollection.look([4, 5], detect)
    assert seen.shape == (2, 3, 2)
    assert seen[:, 0, 0].tolist() == [1, 2]
    # 4 has the oldest detections, then 5, and then the new one, since 4 was renewed before it
    assert recollection.look([4, 5, 6], detect)[:, 0, 0].tolist() == [3, 2, 4]
    assert recollection.look([5, 4, 6], detect)[:, 0, 0].tolist() == [5, 3, 4]
    assert recollection.look([4, 6], detect)[:, 0, 0].tolist() == [6, 4]
    # 5 was forgotten
    assert recollection.look([5, 6], detect)[:, 0, 0].tolist() == [7, 8]


def test_a_checkpoint_has_the_detections_and_their_order():
    one, other, detect = Recollection(1), Recollection(1), Detector()
    assert one.tensors() == {}
    other.load({}, torch.device("cpu"))
    one.look([1, 2, 3], detect)
    one.look([1, 2, 3], detect)
    other.load(one.tensors(), torch.device("cpu"))
    for recollection in (one, other):
        detect.asked = 10
        assert recollection.look([1, 2, 3], detect)[:, 0, 0].tolist() == [4, 11, 3]
