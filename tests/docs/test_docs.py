"""docs/commands: a page a command, whose tables of options are what the command takes.

`python tests/docs/test_docs.py` writes the tables anew.
"""

import ast
import inspect
import json
import re
from dataclasses import MISSING
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

import simtune
from simtune import config
from simtune.cli import commands
from simtune.cli.help import grouped, texts
from simtune.tasks import load_task

FOLDER = Path(__file__).parents[2] / "docs" / "commands"
PAGES = {
    "check": config.CheckConfig,
    "tune": config.TuneConfig,
    "train": config.TrainConfig,
    "record": config.RecordConfig,
    "evaluate": config.EvaluateConfig,
    "export": config.ExportConfig,
    "compare": config.CompareConfig,
    "sweep": config.SweepConfig,
    "figures": config.FiguresConfig,
    "report": commands.ReportCommand,
    "tasks": commands.TasksCommand,
    "example": commands.ExampleCommand,
}
POSITIONAL = {"task": "TASK", "run_folder": "RUN", "run_folders": "RUN RUN ..."}
POSITIONAL |= {"grid": "GRID", "folder": "DIR"}
_NAMED = {commands.TasksCommand: "[NAME]", commands.ExampleCommand: "NAME"}
TABLE = re.compile(r"\| option \|.*?(?=\n\n|\n?\Z)", re.S)


def table(cls: type) -> str:
    told, lines = texts(cls), ["| option | default | |", "|---|---|---|"]
    for field in chain.from_iterable(grouped(cls).values()):  # as --help shows them
        is_needed = field.default is MISSING
        named = _NAMED.get(cls) if field.name == "name" else POSITIONAL.get(field.name)
        name = named or f"--{field.name.replace('_', '-')}"
        plain = "" if field.default is None else f"`{field.default}`"
        plain = "off" if field.default is False else plain
        lines.append(f"| `{name}` | {'needed' if is_needed else plain} | {told[field.name]} |")
    return "\n".join(lines)


@pytest.mark.parametrize("name", PAGES)
def test_a_page_lists_every_option(name):
    page = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    *_, options = page.split("\n## Options\n\n")
    assert options.rstrip() == table(PAGES[name])


def test_every_command_has_a_page_and_links_lead_somewhere():
    named = re.findall(r'subcommand\("(\w+)"\)', inspect.getsource(commands))
    assert {path.stem for path in FOLDER.iterdir()} == set(named)
    for page in [*FOLDER.iterdir(), *FOLDER.parent.glob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)[^):]*\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def blocks_of(path: Path) -> list[str]:
    """The Python of a page, with calls of simtune between its words, a notebook or a script."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return [text]
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    return blocks + re.findall(r"`(simtune\.\w+)\(", text)


def private_uses(blocks: list[str], functions: set[str]) -> set[str]:
    """What Python takes of simtune that is not its API.

    That is what it imports of simtune's modules, other attributes of `simtune` than it offers, and
    calls of `functions`, those in src, that the blocks neither define nor import from elsewhere.
    """
    found, called, own = set[str](), set[str](), set[str]()
    for node in chain.from_iterable(ast.walk(ast.parse(block)) for block in blocks):
        match node:
            case ast.Import(names=names):
                found |= {n.name for n in names if n.name.startswith("simtune.")}
                own |= {n.asname or n.name for n in names}
            case ast.ImportFrom(module=str(module), names=names):
                own |= {n.asname or n.name for n in names}
                if module.startswith("simtune."):
                    found.add(module)
                elif module == "simtune":
                    found |= {n.name for n in names} - {*simtune.__all__}
            case ast.Attribute(value=ast.Name(id="simtune"), attr=attribute):
                found |= {attribute} - {*simtune.__all__}
            case ast.Call(func=ast.Name(id=name)):
                called.add(name)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                own.add(name)
            case ast.Name(id=name, ctx=ast.Store()):
                own.add(name)
    return found | ((called & functions) - own)


def test_pages_and_examples_need_nothing_private():
    root = FOLDER.parents[1]
    modules = (root / "src" / "simtune").rglob("*.py")
    inside = "\n".join(path.read_text(encoding="utf-8") for path in modules)
    functions = set(re.findall(r"^def ([a-z]\w+)\(", inside, re.MULTILINE))
    pages = [root / "README.md", *FOLDER.glob("*.md"), *FOLDER.parent.glob("*.md")]
    examples = (root / "src/simtune/examples").rglob("*.py")
    # Slow tests make virtual environments there, .venv-NAME, with other people's code.
    own = [path for path in examples if "/." not in path.relative_to(root).as_posix()]
    pages += [*FOLDER.parent.glob("*.ipynb"), *own]
    functions -= {*simtune.__all__}  # Playground has a train as well
    private = {page.name: private_uses(blocks_of(page), functions) for page in pages}
    assert {name: uses for name, uses in private.items() if uses} == {}
    assert sum(len(blocks_of(page)) for page in pages) > 20


def test_a_page_may_define_a_function_that_is_named_like_one_inside():
    own = "def load_task(): ...\nload_task()\nsimtune.tune('cartpole', out='run')"
    assert private_uses([own], {"load_task"}) == set()
    assert private_uses(["load_task('cartpole')"], {"load_task"}) == {"load_task"}
    inner = "from simtune.tasks import load_task\nfrom simtune import budget\nsimtune.fit()"
    assert private_uses([inner, "load_task()"], {"load_task"}) == {"simtune.tasks", "budget", "fit"}


def test_links_to_pages_say_in_words_where_they_lead():
    root = FOLDER.parents[1]
    pages = [root / "README.md", *FOLDER.iterdir(), *FOLDER.parent.glob("*.md")]
    for page in pages:
        named = re.findall(r"\[[\w/-]+\.md\]\(", page.read_text(encoding="utf-8"))
        assert not named, f"{page.name}: {named}"


if __name__ == "__main__":
    for name, cls in PAGES.items():
        path = FOLDER / f"{name}.md"
        path.write_text(TABLE.sub(lambda _, c=cls: table(c), path.read_text(encoding="utf-8")))


_SO_101 = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
JOINTS = {
    "Video and readings in one file": ("elbow", "wrist"),
    "SO-101": _SO_101,
    "xArm 7": tuple(f"joint{i}" for i in range(1, 8)),
}


@pytest.mark.parametrize("robot", list(JOINTS))
def test_tuning_files_of_your_robot_load_with_such_a_model(robot: str, tmp_path: Path):
    page = (FOLDER.parent / "your-robot.md").read_text(encoding="utf-8")
    text = page.split(f"## {robot}")[1].split("```toml\n")[1].split("```")[0]
    spec = mujoco.MjSpec()
    body = spec.worldbody
    for joint in JOINTS[robot]:  # a chain of links, with servos as these models have them
        body = body.add_body(name=f"{joint}_link", pos=[0, 0, 0.1])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0])
        body.add_joint(name=joint, axis=[0, 1, 0], range=[-2, 2])
        servo = spec.add_actuator(name=joint, target=joint)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=10.0)
    box = spec.worldbody.add_body(name="box")
    box.add_freejoint(name="box_joint")
    box.add_geom(name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02])
    spec.worldbody.add_camera(name="front", pos=[0, -1, 0.2], xyaxes=[1, 0, 0, 0, 0, 1])
    spec.compile()
    model = tmp_path / text.split('model = "')[1].split('"')[0]
    model.parent.mkdir(exist_ok=True)
    model.write_text(spec.to_xml())
    (tmp_path / "tune.toml").write_text(text)
    task = load_task(str(tmp_path / "tune.toml"))
    assert task.sensors[0].size == min(len(JOINTS[robot]), 5 if robot == "SO-101" else 7)
    colours = text.count('kind = "colour"')  # of three numbers each
    assert len(task.parameters) == text.count("[[parameters]]") + 2 * colours


def test_a_planar_robot_in_pixels_is_where_the_page_says(tmp_path: Path):
    page = (FOLDER.parent / "tuning-file.md").read_text(encoding="utf-8")
    section = page.split("### A planar robot in pixels")[1].split("\n## ")[0]
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="pusher")
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.015, 0, 0])
    for name, axis in (("pusher_x", [1, 0, 0]), ("pusher_y", [0, 1, 0])):
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        servo = spec.add_actuator(name=name, target=name)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=50.0)
    spec.compile()
    (tmp_path / "model.xml").write_text(spec.to_xml())
    text = section.split("```toml\n")[1].split("```")[0]
    mass = '[[parameters]]\nname = "mass"\nkind = "mass"\nobjects = "pusher"\n'
    head = 'model = "model.xml"\ncontrol_timestep_s = 0.1\n'
    (tmp_path / "tune.toml").write_text(head + text + mass)
    task = load_task(str(tmp_path / "tune.toml"))
    (sensor,) = task.sensors
    pixels = np.array([[0.0, 0.0], [256, 256], [512, 100]])  # the upper left corner, the middle
    metres = sensor.from_recorded(pixels, 0.1)
    np.testing.assert_allclose(metres, [[-0.256, 0.256], [0, 0], [0.256, 0.156]], atol=1e-12)
    simulator = task.simulator(image_size=16)
    controls = simulator.action_mapping.apply(Batch(simulator.model, 3), pixels)
    np.testing.assert_allclose(controls, metres, atol=1e-12)
