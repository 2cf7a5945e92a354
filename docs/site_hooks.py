"""What the site needs beside the pages that are read in the repository (mkdocs.yml).

The home page is README.md. The site does not have the repository's other files: links to them
become their paths.
"""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_ROOT = Path(__file__).parents[1]
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((?!\w+:|#)([^)#]*)[^)]*\)")  # to a file, no picture


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    readme = (_ROOT / "README.md").read_text("utf-8").replace("](docs/", "](")
    files.append(File.generated(config, "index.md", content=readme))
    return files


def on_page_markdown(text: str, *, page: Page, **_: object) -> str:
    """Raises FileNotFoundError for a link to what is neither in the site nor in the repository."""
    docs = _ROOT / "docs"
    folder = (docs / page.file.src_uri).parent

    def of_the_site(link: re.Match[str]) -> str:
        shown, target = link.groups()
        found = [path for path in (folder / target, _ROOT / target) if path.exists()]
        if not found:
            raise FileNotFoundError(f"{page.file.src_uri} links to {target}, which is not there")
        path = found[0].resolve()
        if path.is_file() and path.is_relative_to(docs):
            return link.group()
        name = f"`{path.relative_to(_ROOT)}`"
        return name if shown.strip("`") in name else f"{shown} ({name})"

    return _LINK.sub(of_the_site, text)
