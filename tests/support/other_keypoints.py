"""Keypoints as another machine might choose them."""

from simtune.vision.keypoints import Keypoints, find_keypoints


def find_others(*given) -> Keypoints:
    """As many as there are, in another order."""
    found = find_keypoints(*given)
    return found.select(list(range(len(found)))[::-1])
