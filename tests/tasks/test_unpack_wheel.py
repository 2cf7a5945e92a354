"""examples/unpack_wheel.py, which prepares the examples of other people's robots."""

import subprocess
import sys
import zipfile
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "examples" / "unpack_wheel.py"


def unpack(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


def test_a_folder_of_a_wheel_is_unpacked_and_nothing_else(tmp_path: Path):
    wheel = tmp_path / "arm-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as files:
        for name in ("arm/xmls/arm.xml", "arm/xmls/assets/hand.stl", "arm/code.py"):
            files.writestr(name, name)
    assert unpack(wheel, "arm/xmls/", tmp_path / "model").returncode == 0
    found = {str(p.relative_to(tmp_path / "model")) for p in (tmp_path / "model").rglob("*.*")}
    assert found == {"arm.xml", "assets/hand.stl"}
    assert (tmp_path / "model" / "arm.xml").read_text() == "arm/xmls/arm.xml"
    missing = unpack(wheel, "leg/", tmp_path / "other")
    assert missing.returncode != 0
    assert "has no leg/" in missing.stderr
