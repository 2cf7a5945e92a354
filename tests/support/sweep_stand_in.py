"""A run of a fifth of a second or so, for tests of sweeps: COMMAND TASK --out RUN --seed N ...

It goes on where it was killed, refuses a folder that another process writes, and writes its result
and then its report, as the real one does. Beside the sweep's folder it notes, in STAND_IN: a line
in `begun` as it starts; `doubled` where it should not have been started. Seed 1013 always fails;
seed 1015 finds its input unusable; seed 1016 finds two minutes too short until there is a file
`idle`; seed 1014 finds the disk full until there is a file `room`.
"""

import fcntl
import json
import os
import sys
import time
from pathlib import Path

STEPS = 10


def note(name: str, words: str) -> None:
    with (Path(os.environ["STAND_IN"]) / name).open("a") as file:
        file.write(f"{words}\n")


def main() -> None:
    options = dict(zip(sys.argv[3::2], sys.argv[4::2], strict=True))
    out, seed = Path(options["--out"]), int(options["--seed"])
    cores = ",".join(map(str, sorted(os.sched_getaffinity(0))))
    note("begun", f"{out.name} {os.getpid()} {os.getppid()} {cores}")
    if seed == 1013:
        sys.exit("simtune: unlucky")
    if seed == 1015:
        print("simtune: no such recordings", file=sys.stderr)
        sys.exit(2)
    minutes, is_idle = options["--budget-minutes"], (Path(os.environ["STAND_IN"]) / "idle").exists()
    if seed == 1016 and float(minutes) <= 2 and not is_idle:
        print(f"simtune: --budget-minutes {minutes} is too short: give more", file=sys.stderr)
        sys.exit(2)
    if seed == 1014 and not (Path(os.environ["STAND_IN"]) / "room").exists():
        note("full", out.name)
        sys.exit("simtune: [Errno 28] No space left on device: 'checkpoint'")
    if (out / "result.json").exists() and (out / "report.html").exists():
        note("doubled", f"{out.name} was done")
    out.mkdir(exist_ok=True)
    folder = os.open(out, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        note("doubled", f"{out.name} was going on")
        sys.exit("simtune: it is being written by a run that is still going")
    steps = out / "step"
    for step in range(int(steps.read_text()) if steps.exists() else 0, STEPS):
        time.sleep(float(os.environ.get("STAND_IN_STEP_S", "0.02")))
        replace(steps, str(step + 1))
    wall_s = float(os.environ.get("STAND_IN_WALL_S", "0.2"))
    result = {"task": sys.argv[2], "seed": seed, "wall_s": wall_s, "percent_error": seed / 10}
    replace(out / "result.json", json.dumps(result))
    replace(out / "report.html", "a report")


def replace(path: Path, content: str) -> None:
    temporary = path.with_suffix(".tmp")
    temporary.write_text(content)
    os.replace(temporary, path)


if __name__ == "__main__":
    main()
