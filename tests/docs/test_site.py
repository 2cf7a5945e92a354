"""The docs as a site, and the notebook in it: make docs."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "notebook.ipynb"

needs_docs = pytest.mark.skipif(
    not importlib.util.find_spec("mkdocs"), reason="needs the group docs (make docs)"
)


def cells() -> list[dict]:
    return json.loads(NOTEBOOK.read_text("utf-8"))["cells"]


def test_the_notebook_shows_what_it_came_to():
    codes = [cell for cell in cells() if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in codes] == list(range(1, len(codes) + 1))
    outputs = [output for cell in codes for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error"]
    assert "identified" in json.dumps(outputs)
    assert "/root/" not in json.dumps(outputs)


@needs_docs
@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stderr
    home = (tmp_path / "index.html").read_text("utf-8")
    assert 'href="tutorial.html"' in home
    assert 'href="site.css"' in home
    linked = re.findall(r'(?:href|src)="([^":#]+)[#"]', home.partition("<article")[2])
    assert len(linked) > 10
    assert [path for path in linked if not (tmp_path / path).exists()] == []
    assert "budget_minutes" in (tmp_path / "api.html").read_text("utf-8")
    assert (
        "tuned_worlds"
        in json.loads((tmp_path / "search" / "search_index.json").read_text())["docs"].__repr__()
    )


@needs_docs
@pytest.mark.slow
def test_the_notebook_runs(monkeypatch):
    import nbformat  # type: ignore[import-not-found]
    from nbclient import NotebookClient  # type: ignore[import-not-found]

    # A cell calls simtune, which is on the path of those who have activated the environment.
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(
        notebook, timeout=900, resources={"metadata": {"path": str(NOTEBOOK.parent)}}
    )
    client.execute()  # raises what a cell raises
    (table,) = (
        output["text"]
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if "truth" in output.get("text", "")
    )
    rows = [line.split() for line in table.splitlines()]
    held = [float(low) <= float(real) <= float(high) for _, _, low, _, high, _, real, *_ in rows]
    assert len(held) == 4
    assert sum(held) >= 3
