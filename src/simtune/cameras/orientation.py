"""Pictures as players show them: turned or mirrored, as the file says that the camera was held."""

import av
import numpy as np


def as_shown(picture: np.ndarray, frame: av.VideoFrame) -> np.ndarray:
    """(H, W, 3) picture of a frame, turned by quarter turns and mirrored; perhaps a view of it."""
    if (said := frame.side_data.get("DISPLAYMATRIX")) is None:
        return picture
    # Shown at (a · x + c · y, b · x + d · y); fixed-point numbers, of which signs matter
    a, b, _, c, d = np.frombuffer(bytes(said), np.int32)[:5].tolist()
    if abs(b) > abs(a):
        picture, a, d = picture.swapaxes(0, 1), c, b
    return picture[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]
