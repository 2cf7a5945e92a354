"""Visual geometry in a URDF's text, for MuJoCo, which would refuse or confuse some meshes."""

import logging
import re
from functools import cache
from pathlib import PurePosixPath

from simtune.columns import cut

log = logging.getLogger(__name__)

_READ = (".obj", ".stl", ".msh")  # meshes that MuJoCo reads
_MOST_NAMED = 3
_LINK, _VISUAL, _COLLISION = (
    re.compile(rf"<{tag}\b[^>]*(?<!/)>(.*?)</{tag}\s*>", re.DOTALL)
    for tag in ("link", "visual", "collision")
)
_MESH = re.compile(r"""(<mesh\b[^>]*?\bfilename\s*=\s*)(["'])(.*?)\2""")


def draw_all_links(text: str, name: str) -> str:
    """The text without visual meshes that MuJoCo cannot read, such as Collada's; warns of them.

    Links that lose one are drawn as they collide: copies of their collision geometry are added to
    what is seen. (MuJoCo merges links that a fixed joint connects, and `read_urdf` hides what
    collides of a body of which anything is seen.)
    """
    unread: dict[str, None] = {}

    def without_unread(link: re.Match) -> str:
        lost = [v[0] for v in _VISUAL.finditer(link[0]) if not _is_read(v[0])]
        if not lost:
            return link[0]
        drawn = link[0]
        for visual in lost:
            unread.update(dict.fromkeys(PurePosixPath(f).name for f in _files(visual)))
            drawn = drawn.replace(visual, "\n" * visual.count("\n"))  # lines keep their numbers
        bodies = (c[1].replace("\n", " ") for c in _COLLISION.finditer(drawn))
        start, end, rest = drawn.rpartition("</link")
        return start + "".join(f"<visual>{body}</visual>" for body in bodies) + end + rest

    text = _LINK.sub(without_unread, text)
    if unread:
        _warn_once(
            f"{name}: MuJoCo reads no {cut([*unread], _MOST_NAMED)}, so links of such meshes are "
            "drawn as they collide; where a camera sees another shape, convert the files to .obj"
        )
    return text


def tell_meshes_apart(text: str) -> tuple[str, dict[str, str]]:
    """The text with other names of some meshes, and {name: file} of these.

    MuJoCo calls a mesh by its file's name without folder and ending, and takes the first for all
    of that name. Without this, a link could collide as it, or as another, looks.
    """
    taken: dict[str, str] = {}
    names: dict[str, str] = {}

    def renamed(mesh: re.Match) -> str:
        start, quote, file = mesh.groups()
        path = PurePosixPath(file)
        if taken.setdefault(path.stem, file) == file:
            return mesh[0]
        name = names.setdefault(file, f"{path.stem}_{len(names)}_of_simtune{path.suffix}")
        return f"{start}{quote}{name}{quote}"

    for part in (_COLLISION, _VISUAL):  # in this order: names of what collides stay, if they can
        text = part.sub(lambda found: _MESH.sub(renamed, found[0]), text)
    return text, {name: file for file, name in names.items()}


def _files(element: str) -> list[str]:
    return [mesh[3] for mesh in _MESH.finditer(element)]


def _is_read(visual: str) -> bool:
    return all(file.lower().endswith(_READ) for file in _files(visual))


@cache
def _warn_once(message: str) -> None:
    """A run reads its model several times."""
    log.warning("%s", message)
