"""Names that users choose by: commands ask for them, and the layers below look them up."""

from typing import Literal

RendererName = Literal["raycaster", "opengl"]
ExportFormat = Literal["samples", "mjlab", "playground"]
SearchName = Literal["posterior", "paper", "regression"]
