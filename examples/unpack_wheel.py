"""Unpacks a folder of a Python wheel, without installing it.

python unpack_wheel.py PACKAGE==VERSION|FILE.whl FOLDER/IN/IT/ TARGET

A package is downloaded by pip.
"""

import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path


def main(wheel: str, prefix: str, target: Path) -> None:
    with tempfile.TemporaryDirectory() as downloads:
        if not wheel.endswith(".whl"):
            pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
            subprocess.run([*pip, "--dest", downloads, wheel], check=True)
            wheel = str(next(Path(downloads).glob("*.whl")))
        with zipfile.ZipFile(wheel) as files:
            names = [n for n in files.namelist() if n.startswith(prefix) and not n.endswith("/")]
            if not names:
                sys.exit(f"{wheel} has no {prefix}")
            for name in names:
                path = target / name.removeprefix(prefix)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(files.read(name))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
