"""report.html in a real browser: its script runs, and it fits a phone."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from test_report import make_run

from simtune.report import write_report

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run --disable-sync"
)
FLAGS += " --disable-background-networking --disable-component-update --disable-quic"
# What only a browser knows, left in the page where the test finds it.
MEASURE = """
<script>
addEventListener("load", () => setTimeout(() => {
  const page = document.documentElement, data = document.body.dataset;
  data.overflow = page.scrollWidth - innerWidth;
  data.controls = !document.querySelector("#videos .controls").hidden;
  data.links = [...document.querySelectorAll("a[download]")].filter((a) => a.href).length;
  data.playing = [...document.querySelectorAll("video")].filter((v) => v.duration > 0).length;
}, 1500));
</script>
"""

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")


def browse(page: Path, folder: Path, *flags: str) -> str:
    """What the browser prints."""
    assert CHROMIUM
    own = [f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=8000"]
    command = [CHROMIUM, *FLAGS.split(), *own, *flags, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.thorough
@pytest.mark.parametrize("width", [500, 1280])
def test_the_script_runs_and_nothing_overflows(width, tmp_path):
    page = write_report(make_run(tmp_path / "run"))
    measured = tmp_path / "measured.html"
    measured.write_text(page.read_text().replace("</body>", MEASURE + "</body>"))
    dom = browse(measured, tmp_path, f"--window-size={width},2000", "--dump-dom")
    said = dict(re.findall(r'data-(\w+)="(-?\w+)"', re.search(r"<body[^>]*>", dom)[0]))
    assert int(said["overflow"]) <= 0
    assert said["controls"] == "true"
    assert int(said["links"]) == 4  # three films and result.json
    assert int(said["playing"]) == 3


# A browser's own window is no narrower than 500 pixels; a frame in it is.
PHONE = """
<body><script>addEventListener("message", (m) => { document.body.dataset.overflow = m.data; });
</script><iframe src="inner.html" style="width: 385px; height: 2000px; border: 0"></iframe></body>
"""
TELL = """
<script>
addEventListener("load", () => setTimeout(() => {
  const page = document.documentElement;
  parent.postMessage(page.scrollWidth - page.clientWidth, "*");
}, 1000));
</script>
"""


@pytest.mark.thorough
def test_nothing_overflows_a_phone(tmp_path):
    run = make_run(tmp_path / "run")
    part = {"px": 1.5, "px_before": 11.8, "pictures_along": None, "pictures_along_before": None}
    result = json.loads((run / "result.json").read_text()) | {"moving_parts": {"ball": part}}
    (run / "result.json").write_text(json.dumps(result))
    page = write_report(run).read_text()
    assert "Within 2 px, before" in page
    (tmp_path / "inner.html").write_text(page.replace("</body>", TELL + "</body>"))
    (tmp_path / "outer.html").write_text(PHONE)
    dom = browse(tmp_path / "outer.html", tmp_path, "--dump-dom")
    assert 'data-overflow="0"' in dom


@pytest.mark.thorough
def test_the_report_can_be_drawn_by_a_browser(tmp_path):
    page, picture = write_report(make_run(tmp_path / "run")), tmp_path / "page.png"
    browse(page, tmp_path, "--window-size=1100,1500", f"--screenshot={picture}")
    assert picture.stat().st_size > 20_000  # an empty page has a few kB
