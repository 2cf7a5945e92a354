"""The report's section on a trained policy: how it learnt, and what it does in the real world."""

import base64

from simtune.report.axis import Axis, value_axis
from simtune.report.data import POLICY_VIDEO, RunData
from simtune.report.svg import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, frame, horizontal, line, svg
from simtune.report.words import count, number
from simtune.validate import is_number

_DRAWN = {"filmed": "estimate", "unfilmed": "start"}  # kinds of line


def policy(run: RunData) -> str:
    """Empty where none was trained."""
    drawn, score = _learning_curve(run), run.get("return")
    if not drawn:
        return ""
    said = ""
    if isinstance(score, dict):
        said = (
            f"<p>Scored in the pseudo-real world on {count(score.get('episodes'))} episodes that "
            f"nothing was learnt from: return <b>{number(score.get('mean'))}</b> ± "
            f"{number(score.get('std'))}. It saw pictures and nothing else.</p>"
        )
    has_teacher = any(entry.get("filmed") == 0 for entry in run.metrics)
    legend = (
        "<p class='legend'><span><i class='estimate'></i>acting on pictures</span>"
        + "<span><i class='start'></i>its teacher, who knows the state</span>" * has_teacher
        + ("<span><i class='truth'></i>scored</span>" if said else "")
        + "<span>returns of episodes in simulation, with all that is tried out in them</span></p>"
    )
    shown = f"<div class='policy'>{drawn}{_video(run)}</div>"
    return f"<section><h2>The policy</h2>{said}{legend}{shown}</section>"


def _learning_curve(run: RunData) -> str:
    """Returns against policy steps, one line for episodes on pictures and one for the others."""
    lines: dict[str, list[tuple[float, float]]] = {kind: [] for kind in _DRAWN}
    for entry in run.metrics:
        if is_number(earned := entry.get("return/simulated")):
            kind = "filmed" if entry.get("filmed") else "unfilmed"
            lines[kind].append((float(entry["step"]), earned))
    points = [point for line_ in lines.values() for point in line_]
    if len(points) < 2:
        return ""
    score = run.get("return")
    mean = score.get("mean") if isinstance(score, dict) else None
    returns = [earned for _, earned in points] + ([mean] if is_number(mean) else [])
    x = Axis(0, max(step for step, _ in points), LEFT + 4, WIDTH - RIGHT - 4)
    y = value_axis([0.0, *returns], HEIGHT - BOTTOM, TOP, is_colour=False)
    labels = [(x(t), f"{t / 1000:g}k" if t else "0") for t in x.ticks(4)]
    parts = [frame(y, y.ticks(5), labels, "steps in simulation")]
    if is_number(mean):
        parts.append(horizontal(y(mean), "truth"))
    for kind, drawn in lines.items():
        if drawn:
            parts.append(line([(x(step), y(earned)) for step, earned in drawn], _DRAWN[kind]))
    return svg("return against steps in simulation", parts)


def _video(run: RunData) -> str:
    if POLICY_VIDEO not in run.videos:
        return ""
    data = base64.b64encode(run.videos[POLICY_VIDEO]).decode()
    return (
        "<video muted loop controls playsinline aria-label='the policy in the real world' "
        f"src='data:video/mp4;base64,{data}'></video>"
    )
