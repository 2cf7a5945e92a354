"""README.md and the guides in docs: commands can be followed, figures are today's."""

import json
import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GUIDES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
_CODE = re.compile(r"```(?:sh|python)\n(.*?)```", re.DOTALL)
_WRITES = re.compile(r"""--out (\S+)|\.export\("([^"]+)"|\bout="([^"]+)\"""")
_GOES_ON = ("tune", "train", "sweep", "check")  # the same command continues what it began


def written(page: str) -> dict[str, list[str]]:
    """{folder: the commands of a page that write it}."""
    code = "\n".join(_CODE.findall(page)).replace("\\\n", " ")
    found = defaultdict(list)
    for line in code.splitlines():
        for names in _WRITES.findall(line):
            found["".join(names)].append(line.partition(" #")[0].strip())
    return found


def is_one_command(lines: list[str]) -> bool:
    """Whether they are one command that goes on, with or without a last option."""
    first = min(lines, key=len)
    goes_on = first.removeprefix("simtune ").split()[0] in _GOES_ON
    return goes_on and all(line.startswith(first) for line in lines)


@pytest.mark.parametrize("path", GUIDES, ids=lambda path: path.stem)
def test_no_two_commands_of_a_page_write_one_folder(path: Path):
    """An export into a folder that has files is refused, and a run of something else as well."""
    for folder, lines in written(path.read_text(encoding="utf-8")).items():
        assert len(lines) == 1 or is_one_command(lines), f"{folder}: {lines}"


def test_commands_that_write_one_folder_are_found():
    page = (
        '```python\nresult.export("tuned")  # a\n```\n```sh\nsimtune export a \\\n --out tuned\n```'
    )
    assert {folder: len(lines) for folder, lines in written(page).items()} == {"tuned": 2}
    assert not is_one_command(written(page)["tuned"])
    assert is_one_command(["simtune tune a --out b --move", "simtune tune a --out b"])
    assert not is_one_command(["simtune tune a --out b", "simtune tune c --out b"])


@pytest.mark.thorough
def test_the_tutorial_shows_what_check_prints(monkeypatch: pytest.MonkeyPatch):
    from simtune.checking import carry_out
    from simtune.config import CheckConfig
    from simtune.progress import silent

    monkeypatch.chdir(ROOT)
    section = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8").split("\n## 4.")[1]
    _, command, _, shown, *_ = re.split(r"```(?:sh)?\n", section)
    simtune, check, task, option, real = command.split()
    assert (simtune, check, option) == ("simtune", "check", "--real")
    _, lines = carry_out(CheckConfig(task=task, real=Path(real)), silent)
    printed = {line.split()[0]: line for line in lines if line}
    for line in shown.splitlines():
        its = printed[line.split()[0]]
        assert re.sub(r"[\d.]+", "0", line) == re.sub(r"[\d.]+", "0", its)
        numbers = (re.findall(r"[\d.]+", words) for words in (line, its))
        for told, known in zip(*numbers, strict=True):
            digit = 10.0 ** -len(told.partition(".")[2])  # other machines round otherwise
            assert abs(float(told) - float(known)) < 1.01 * digit, (line, its)


def held(task: str, *names: str) -> tuple[int, int, int]:
    """Intervals that held, all, and runs of a task; of parameters whose names begin so."""
    text = (ROOT / "docs" / "results" / "whole_runs" / f"{task}.jsonl").read_text(encoding="utf-8")
    runs = [holds for line in text.splitlines() if (holds := json.loads(line).get("holds"))]
    told = [its for holds in runs for name, its in holds.items() if name.startswith(names or ("",))]
    return sum(told), len(told), len(runs)


def figures() -> dict[str, list[str]]:
    """{page: what it says of whole runs}, by the lines that are kept of them."""
    five = [held(task) for task in ("ball_in_cup", "walker", "cheetah", "finger", "cartpole")]
    num_held, num, runs = (f"{sum(column):,}" for column in zip(*five, strict=True))
    masses, colours = (
        held("walker_links", *names) for names in (("torso", "thighs", "legs"), ("body_",))
    )
    peg, rope = held("rope_peg"), held("rope_peg", "rope_length")
    hard = [
        f"{masses[0]} of {masses[1]} intervals of the masses held",
        f"{colours[0]} of {colours[1]} of its body's colours",
        f"{rope[0]} of {rope[1]} held for the rope's length",
        f"{peg[0]} of {peg[1]} in all",
    ]
    easy = f"{num_held} of {num} intervals"
    of_runs = [
        f"In {masses[2]} [whole runs]",
        f"In {peg[2]} runs of `rope_peg`",
        f"In {runs} later",
    ]
    note = [f"In {runs} runs of the five tasks", easy]
    return {
        "README.md": [*hard, easy, *of_runs],
        "docs/results.md": [*hard, *note],
        "docs/limits.md": hard,
    }


@pytest.mark.parametrize("page", ["README.md", "docs/results.md", "docs/limits.md"])
def test_a_page_counts_the_intervals_of_all_whole_runs(page: str):
    """Whoever adds runs to docs/results/whole_runs mends these sentences as well."""
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    for words in figures()[page]:
        assert words in text


def test_far_off_and_identified_are_as_many_as_the_readme_says():
    rows = json.loads((ROOT / "docs/results/whole_runs.json").read_text(encoding="utf-8"))["rows"]
    hard = [row for row in rows if row["task"] in ("walker_links", "rope_peg")]
    assert sum(len(row["identified_far_off"]) for row in hard) == 12
    num = held("walker_links")[1] + held("rope_peg")[1]
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert f"Twelve of these {num} estimates" in text
