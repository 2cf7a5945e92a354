"""URDF: links are drawn by their visual geometry, and its packages' files are found."""

import re
from pathlib import Path

import mujoco

_HIDDEN = 3  # a group that no renderer draws
_KEEP_VISUALS = '<mujoco><compiler discardvisual="false"/></mujoco>'


def read_urdf(path: Path) -> mujoco.MjSpec:
    """A URDF whose links are drawn as a camera sees them.

    By default MuJoCo drops visual geometry, and draws what is meant for collisions. Here that is
    hidden, in links that have both. A file with a <mujoco> of its own is read as it says. Raises
    ValueError if MuJoCo cannot read it.
    """
    text = path.read_text(encoding="utf-8")
    if "<mujoco" in text:
        return mujoco.MjSpec.from_file(str(path))
    spec = mujoco.MjSpec.from_string(
        re.sub(r"(<robot\b[^>]*>)", rf"\1{_KEEP_VISUALS}", text, count=1)
    )
    spec.modelfiledir = str(path.parent)
    for body in spec.bodies:
        geoms = list(body.geoms)
        seen = [geom for geom in geoms if not geom.contype and not geom.conaffinity]
        for geom in geoms:
            if seen and geom not in seen:
                geom.group = _HIDDEN
    return spec


def find_packages(spec: mujoco.MjSpec, model: Path) -> None:
    """Resolve "package://NAME/FILE" to a file in a folder NAME, or beside the model."""
    for mesh in spec.meshes:
        if not (words := re.fullmatch(r"package:/+([^/]+)/(.+)", mesh.file)):
            continue
        package, file = words.groups()
        folders = model.resolve().parents
        places = [folder / package / file for folder in folders]
        places += [folder / file for folder in folders if folder.name == package]
        places += [folders[0] / file, folders[0] / Path(file).name]
        if found := next((place for place in places if place.is_file()), None):
            mesh.file = str(found)
