"""What a log says of a robot as files: a page to read, a table, and numbers for an experiment."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wmr_afl.analysis import plots
from wmr_afl.analysis.files import keep_only, renewed
from wmr_afl.analysis.page import inline, write_page
from wmr_afl.identification.estimate import NOT_DETERMINED, ROUGH, Estimate
from wmr_afl.identification.held_out import WHOLE, foretold
from wmr_afl.identification.held_out import WINDOW as PIECE
from wmr_afl.identification.identified import Identified
from wmr_afl.identification.motion import Motion
from wmr_afl.model.files import is_shipped
from wmr_input.errors import plain
from wmr_input.whole_files import write_whole

DRAWN = 3  # segments of what was held out, the longest ones
MUCH_LEFT, POOR = 3.0, 80.0  # times the noise, and [%] of what was held out: beyond, the verdict looks doubtful
LINE = 110  # characters of a comment
SHARES = "of voltage: what a number alone accounts for; parts may cancel each other, so that some exceed 100 %"
LONGEST = 60.0  # [s] of a segment that are drawn


def write_identification(found: Identified, source: str, folder: Path) -> list[Path]:
    """Write `identified.toml`, `pi.csv` and `report.html`, all at once; `source` names the log.

    Raises:
        WmrError: if the folder cannot be written.
    """
    with renewed(folder) as beside:
        files = [beside / name for name in ("identified.toml", "pi.csv", "report.html")]
        write_whole(files[0], toml_text(found, source))
        write_whole(files[1], table_text(found))
        write_page("identification_report.html.jinja", files[2], **_content(found, source))
        keep_only(files, beside)
    return [folder / file.name for file in files]


def guess_line(found: Identified) -> str:
    """`guess = { ... }`, exact, for a controller of an experiment."""
    return "guess = { " + ", ".join(f"{name} = {value!r}" for name, value in found.guess.items()) + " }"


def toml_text(found: Identified, source: str) -> str:
    """The physical parameters as an experiment takes them, with what one has to know of them as comments."""
    model = found.model
    robot = model.name if is_shipped(model.folder) else model.folder.resolve().as_posix()
    lines = [
        f"# {model.title}, identified from {plain(source)}.",
        f"# {found.verdict}.",
        "#",
        "# How to use it: copy `robot` and [parameters] into an experiment to simulate this robot, and `guess` under",
        "# [controllers.NAME] or [shared], in place of `estimate`, for a controller that begins with it.",
        "",
        f"robot = {json.dumps(robot, ensure_ascii=False)}",
        guess_line(found),
        "",
        "[parameters]",
    ]
    about = {name: text for name, _, _, text in origins(found)}
    width = max(len(f"{name} = {value!r}") for name, value in found.parameters.items())
    lines += [
        f"{f'{name} = {value!r}':{width}}  # [{model.parameter_units[name]}] {about[name]}"
        for name, value in found.parameters.items()
    ]
    lines.append("")
    for text in open_ends(found):
        lines += wrap(text, LINE, initial_indent="# ", subsequent_indent="#   ")
    lines += [f"#   {name} = {found.effort.formulas[name]}" for name in found.undetermined]
    return "\n".join(lines) + "\n"


def table_text(found: Identified) -> str:
    """CSV: what was sought by name, from the whole log, then from the part that was not held out by each method."""
    methods = {one.estimate.method.replace(" ", "_"): one.estimate for one in found.tried}
    header = ["name", "formula", "unit", "value", "two_sd", "share_of_voltage", "determined"]
    header += [f"{method}{of}" for method in methods for of in ("", "_two_sd", "_determined")]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)

    def numbers(one: Estimate, k: int) -> list[str]:
        return [repr(float(one.unknown[k])), repr(float(one.interval[k])), found.told(one)[k]]

    for k, (name, unit) in enumerate(found.effort.units.items()):
        value, interval, answer = numbers(found.estimate, k)
        row = [name, found.effort.formulas[name], unit, value, interval, repr(float(found.share[k])), answer]
        for one in methods.values():
            row += numbers(one, k)
        writer.writerow(row)
    return text.getvalue()


def origins(found: Identified) -> Iterator[tuple[str, float, float, str]]:
    """Of each physical parameter: name, what was described or given, what was found, and where that is from."""
    sought, kept = found.physical.uncertain, found.physical.kept
    for name, described, value in zip(found.parameters, found.effort.p, found.physical.p, strict=True):
        if name in kept:
            text = "kept near the description"
        elif name in sought:
            text = "from the log" + (", up to a factor" if name in found.physical.scaled else "")
        else:
            text = "given" if name in found.effort.given else "as described: taken as known"
        yield name, float(described), float(value), text


def open_ends(found: Identified) -> Iterator[str]:
    """What the log does not tell, a sentence each."""
    if found.physical.is_contradiction:
        yield (
            "A contradiction: no masses, inertias and motor constants above zero give these numbers. Look for a "
            "voltage or a sensor of the wrong sign, two motors that are swapped, a wheel radius or track far off."
        )
    if found.pushing:
        names = ", ".join(found.pushing)
        yield (
            f"A contradiction: Coulomb friction below zero, which would push a motor: {names}. Look whether "
            "the voltages are those that the motors had, and come at the instant at which the log has them."
        )
    if found.undetermined:
        share, names = f"{100 * NOT_DETERMINED:.0f} %", ", ".join(found.undetermined)
        yield f"Not determined (two standard deviations exceed {share}): {names}. Livelier motion tells more."
    if found.rough:
        share = f"{100 * ROUGH:.0f} to {100 * NOT_DETERMINED:.0f} %"
        yield f"Determined roughly (two standard deviations are {share}): {', '.join(found.rough)}."
    if found.physical.scaled:
        names = ", ".join(found.physical.scaled)
        yield (
            f"Voltages tell {names} up to one common factor only, for which the description stands. A controller needs "
            "no more; for the true ones weigh the robot and give its mass with --set."
        )
    if found.physical.kept:
        yield f"Stayed near the description, since the log says little of each alone: {', '.join(found.physical.kept)}."
    if found.disagreeing:
        names = ", ".join(found.disagreeing)
        yield f"The two methods differ in {names} by more than noise explains: the model's structure limits this log."


def figures(found: Identified) -> dict[str, Figure]:
    """By segment of what was held out: speeds simulated from the voltages beside those measured, and what is left."""
    motions = sorted(found.held, key=lambda motion: -int(motion.ok.sum()))[:DRAWN]
    drawn = {}
    for motion in sorted(motions, key=lambda motion: motion.segment.start):
        name = motion.segment.name or "log"
        figure = _speeds(found, motion)
        if figure is not None:
            drawn[f"{name}, from {motion.segment.start:.4g} s"] = figure
    return drawn


def _speeds(found: Identified, motion: Motion) -> Figure | None:
    """One segment; None if it is too short to be simulated."""
    n, units = found.effort.n, list(found.model.state_units.items())
    rows, simulated = foretold(found.smoother, motion, found.chosen.estimate)
    chosen = motion.segment.time[rows] <= motion.segment.start + LONGEST
    rows, simulated = rows[chosen], simulated[chosen]
    if len(rows) == 0:
        return None
    time, measured = motion.segment.time[rows], motion.x[rows, n:]
    count = measured.shape[1]
    with plots.styled():
        figure = plots.new_figure(9.0, 0.7 + 2.5 * count)
        panels = figure.subplots(2 * count, 1, sharex=True, height_ratios=[2.2, 1.0] * count, squeeze=False)[:, 0]
        for index, (name, unit) in enumerate(units[n:]):
            speeds, residual = panels[2 * index], panels[2 * index + 1]
            speeds.plot(time, measured[:, index], label="measured", **plots.REFERENCE)
            speeds.plot(time, simulated[:, index], label="simulated from the voltages", **plots.style_of(0))
            speeds.set(ylabel=f"{name} [{unit}]")
            residual.axhline(0.0, color="0.55", linewidth=0.8)
            residual.plot(time, measured[:, index] - simulated[:, index], color=plots.COLOURS[1], linewidth=0.9)
            residual.set(ylabel="residual")
        panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
        panels[-1].set(xlabel="time [s]")
        figure.align_ylabels(panels)
    return figure


def _content(found: Identified, source: str) -> dict[str, Any]:
    """What the page shows."""
    effort, tried = found.effort, found.tried
    steps = {f"{1e3 * segment.step:.3g} ms" for segment in found.log.segments}
    return {
        "found": found,
        "source": source,
        "quality": _quality(found),
        "log": {
            "duration": f"{found.log.duration:.1f} s",
            "segments": len(found.log.segments),
            "steps": ", ".join(sorted(steps)),
            "held": f"{sum(float(one.ok.sum()) * one.segment.step for one in found.held):.1f} s",
            "channels": ", ".join(one.name for one in found.log.channels),
        },
        "methods": [one.estimate.method for one in tried],
        "numbers": [
            {
                "name": name,
                "formula": effort.formulas[name].replace("**", "^"),
                "unit": unit,
                "value": f"{found.estimate.unknown[k]:.5g}",
                "interval": f"{found.estimate.interval[k]:.2g}",
                "share": f"{100.0 * found.share[k]:.1f} %",
                "determined": found.told()[k],
                "tried": [f"{one.estimate.unknown[k]:.5g} ± {one.estimate.interval[k]:.2g}" for one in tried],
            }
            for k, (name, unit) in enumerate(effort.units.items())
        ],
        "fits": [
            {"name": name, "fits": [_percent(one.score.each[k]) for one in tried]}
            for k, name in enumerate(list(found.model.state_units)[effort.n :])
        ],
        "overall": [_percent(one.score.overall) for one in tried],
        "misfits": [f"{one.misfit:.3g}" for one in tried],
        "parameters": [
            {
                "name": name,
                "unit": found.model.parameter_units[name],
                "about": found.model.metadata["about"][name],
                "described": f"{described:.5g}",
                "value": f"{value:.5g}",
                "origin": origin,
            }
            for name, described, value, origin in origins(found)
        ],
        "open_ends": list(open_ends(found)),
        "guess": guess_line(found),
        "shares": SHARES,
        "feedforward": found.feedforward,
        "pictures": {name: inline(_png(figure)) for name, figure in figures(found).items()},
        "pieces": f"{PIECE:g} s" if any(one.ok.sum() * one.segment.step > WHOLE for one in found.held) else "",
    }


def _quality(found: Identified) -> str:
    """How the verdict looks."""
    if found.is_contradiction:
        return "bad"
    is_good = found.chosen.misfit < MUCH_LEFT and found.chosen.score.overall > POOR
    return "good" if is_good else "doubtful"


def _percent(fit: float) -> str:
    return f"{fit:.1f} %" if np.isfinite(fit) else "–"


def _png(figure: Figure) -> bytes:
    picture = io.BytesIO()
    with plots.styled():
        figure.savefig(picture, format="png", dpi=150, metadata={"Software": None})
    return picture.getvalue()
