"""Names by which users choose, in commands and below."""

from typing import Literal

RendererName = Literal["raycaster", "opengl"]
ExportFormat = Literal["samples", "mjlab", "playground"]
SearchName = Literal["posterior", "paper", "regression"]
