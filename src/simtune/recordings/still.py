"""Decodes single pictures, PNG or JPEG, from untrusted sources."""

import io
import re

import av
import av.error
import numpy as np

from simtune.errors import InputError
from simtune.recordings.video import MOST_PIXELS, TO_RGB

_SIGNATURES = {"png": b"\x89PNG\r\n\x1a\n", "jpeg": b"\xff\xd8\xff"}
_END_MARKER = 0xD9  # of a JPEG
# Of a segment, or the end; what else follows FF is part of coded pixels, or fills up
_MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd7\xff]")
_DAMAGED = "a picture is damaged; copy the file again"


def kind_of(data: bytes) -> str:
    """png or jpeg. Raises InputError if it is another file."""
    for kind, begin in _SIGNATURES.items():
        if data.startswith(begin):
            return kind
    raise InputError("a picture is neither PNG nor JPEG; write it anew as one")


def decode_picture(data: bytes) -> np.ndarray:
    """(H, W, 3) uint8 RGB of a file's content. Raises InputError."""
    # The kind is given: FFmpeg would also take a playlist, which makes it open other files.
    kind = kind_of(data)
    if kind == "jpeg" and not _has_end(data):
        raise InputError(_DAMAGED)  # cut: FFmpeg would make the rest grey, and say nothing
    try:
        with av.open(io.BytesIO(data), "r", format=f"{kind}_pipe") as container:
            stream = container.streams.video[0]
            height, width = stream.codec_context.height, stream.codec_context.width
            if height * width > MOST_PIXELS:
                raise InputError(
                    f"a picture of {width}×{height} pixels; expected at most 7680×4320, make it "
                    "smaller"
                )
            options = {"max_pixels": str(MOST_PIXELS), "err_detect": "explode"}
            stream.codec_context.options = options
            frame = next(container.decode(stream), None)
            if frame is None or frame.is_corrupt:
                raise InputError(_DAMAGED)
            return frame.to_ndarray(**TO_RGB)
    except av.error.FFmpegError as error:
        raise InputError(
            f"a picture cannot be decoded ({error.strerror}); copy the file again"
        ) from None


def _has_end(data: bytes) -> bool:
    """Whether a JPEG's segments lead to its end, whatever comes after."""
    at = 2
    while (marker := _MARKER.search(data, at)) and marker[0][1] != _END_MARKER:
        at = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2])
    return marker is not None
