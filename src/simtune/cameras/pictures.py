"""Pictures: turned, resized, how many at a time, and their border."""

import functools

import av
import numpy as np

# Points outside of the picture are clipped so far inside: detectors name no place beyond.
BORDER_PX = 0.5
_GPU_PIXELS = 2**23  # in pictures at once: some hundred MB for a detector


def middle_square(frame: np.ndarray) -> np.ndarray:
    """The central square of a picture (H, W, 3), (side, side, 3)."""
    side = min(frame.shape[:2])
    top, left = ((length - side) // 2 for length in frame.shape[:2])
    return frame[top : top + side, left : left + side]


def resize(
    frame: np.ndarray, size: tuple[int, int], covered: tuple[float, float] | None = None
) -> np.ndarray:
    """Resize by area averaging (anti-aliased), each axis separately.

    `frame` is (H, W, 3) uint8, `size` the new (height, width); gives (height, width, 3) uint8. For
    integer factors every new pixel is the mean of its block. `covered`: central rows and columns
    that are shown, by default all; fractions of a pixel count as such.
    """
    # swscale's own AREA would average in subsampled YUV, which is wrong at coloured edges.
    covered = covered or frame.shape[:2]
    if frame.shape[:2] == tuple(size) == tuple(covered):
        return frame
    rows, columns = (
        _area_taps(*lengths) for lengths in zip(frame.shape, size, covered, strict=False)
    )
    # A matrix product would do as well, but wakes all of BLAS's threads for each frame.
    shrunk = sum(weight[:, None, None] * frame[index] for index, weight in rows)
    assert isinstance(shrunk, np.ndarray)
    shrunk = sum(weight[:, None] * shrunk[:, index] for index, weight in columns)
    return np.rint(shrunk).astype(np.uint8)


@functools.cache
def _area_taps(size: int, new_size: int, covered: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Which old pixels each new one covers, and their weights.

    Gives pairs (index, weight), each (new_size,): new = sum of weight * old[index].
    """
    edges = (size - covered) / 2 + np.arange(new_size + 1) * (covered / new_size)
    first = np.floor(edges[:-1] + 1e-9).astype(int)
    taps = []
    for index in range(size):
        pixel = first + index
        overlap = np.minimum(edges[1:], pixel + 1) - np.maximum(edges[:-1], pixel)
        if not (overlap > 1e-9).any():
            break
        weight = (overlap.clip(0) * (new_size / covered)).astype(np.float32)
        taps.append((pixel.clip(max=size - 1), weight))
    return taps


def as_shown(picture: np.ndarray, frame: av.VideoFrame) -> np.ndarray:
    """(H, W, 3) picture of a frame, turned by quarter turns and mirrored; perhaps a view of it.

    As players show it, since the file says that the camera was held so.
    """
    if (said := frame.side_data.get("DISPLAYMATRIX")) is None:
        return picture
    # Shown at (a · x + c · y, b · x + d · y); fixed-point numbers, of which signs matter
    a, b, _, c, d = np.frombuffer(bytes(said), np.int32)[:5].tolist()
    if abs(b) > abs(a):
        picture, a, d = picture.swapaxes(0, 1), c, b
    return picture[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]


def pictures_at_once(device: object, height: int, width: int) -> int:
    """How many are drawn, or looked at, together: what fits a CPU's cache, or fills a GPU.

    `device`: a torch.device, or its name.
    """
    if str(device).startswith("cpu"):
        return 64
    return max(16, min(1024, _GPU_PIXELS // (height * width)))
