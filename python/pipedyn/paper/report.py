# SPDX-License-Identifier: MIT
"""Figures, a table and sentences that report the paper's modal analysis."""

from __future__ import annotations

import string
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from pipedyn import plot
from pipedyn.accuracy.convergence import convergence_law
from pipedyn.linear.critical_speed import CriticalSpeed, stable_speeds
from pipedyn.linear.reach import is_overdamped
from pipedyn.linear.sensitivity import Crossing
from pipedyn.models.continuum import Continuum
from pipedyn.models.pipe import Pipe
from pipedyn.paper.analysis import CHAIN_SIZES, REDUCED_SIZES, Findings, Options, Row, map_top
from pipedyn.plot.arrange import write_inside
from pipedyn.plot.common import open_marker
from pipedyn.plot.linear import DOT, ONSET
from pipedyn.plot.units import FLOW_SPEED, GROWTH, ROOT_FREQUENCY, Units, View
from pipedyn.util.result import Table


def loci_figure(case: Options, findings: Findings) -> plot.Figure:
    """Figure 2 of the paper: root loci of each model."""
    left, right, top = _ranges(findings)
    view = _view(case.pipe)
    rate = view.one(GROWTH)
    picture = partial(plot.root_loci, benchmark=findings.benchmark, highest=findings.highest)
    across = (rate * left, rate * right)
    figure, bar = _panel_figure(case, findings, picture, view.label(FLOW_SPEED), across, rate * top)
    if findings.exact is not None:
        for ax in figure.axes:
            if ax is bar:
                ax.axhline(view.one(FLOW_SPEED) * findings.exact.speed, **CRITICAL_LINE)
            else:
                ax.plot([0.0], [rate * findings.exact.frequency], **CRITICAL_POINT)
    return _with_legend(case, figure, findings, CRITICAL_POINT)


def frequency_figure(case: Options, findings: Findings) -> plot.Figure:
    """Figure 3 of the paper: frequencies of each model against flow speed."""
    left, right, top = _ranges(findings)
    view = _view(case.pipe)
    largest, end = max(-left, right), view.one(FLOW_SPEED) * findings.highest
    picture = partial(plot.frequencies, benchmark=findings.benchmark, largest=largest)
    across = (-0.02 * end, 1.02 * end)
    top *= view.one(ROOT_FREQUENCY)
    figure, bar = _panel_figure(case, findings, picture, view.label(GROWTH), across, top)
    if findings.exact is not None:
        for ax in figure.axes:
            if ax is not bar:
                ax.axvline(view.one(FLOW_SPEED) * findings.exact.speed, zorder=0.6, **CRITICAL_LINE)
    outline = Line2D([], [], color="0.85", linewidth=2.0, label="unstable: black outline")
    outline.set_path_effects([withStroke(linewidth=4.2, foreground="black")])
    return _with_legend(case, figure, findings, CRITICAL_LINE, outline)


CRITICAL_LINE: dict[str, Any] = {"color": "black", "linestyle": ":", "linewidth": 1.1}
CRITICAL_POINT: dict[str, Any] = {"color": plot.VERMILION, "marker": "+", "markersize": 8.0}
CRITICAL_POINT |= {"linestyle": "none", "markeredgewidth": 1.1, "zorder": 5.0}
"""Look of the critical speed of the continuous pipe, as a line and as a point."""


def convergence_figure(case: Options, findings: Findings) -> plot.Figure:
    """Figure of the errors of critical speeds against the number of degrees of freedom."""
    figure = plot.Figure(figsize=(6.4, 5.2), layout="constrained")
    ax = figure.subplots()
    if findings.exact is None:
        plot.notice(findings.remark, ax=ax)
    else:
        plot.convergence(_by_family(findings), findings.exact, ax=ax)
    ax.set_title(_pipe_title(case.pipe))
    return figure


def map_figure(case: Options, findings: Findings) -> plot.Figure:
    """Figure of the stability boundaries over beta, for several gamma."""
    figure = plot.Figure(figsize=(6.4, 4.8), layout="constrained")
    ax = figure.subplots()
    exact, view = findings.exact, _view(case.pipe)
    if exact is not None and not exact.unstable_before:
        place = exact.pipe.beta, view.one(FLOW_SPEED) * exact.speed
        words = rf"$\beta = {exact.pipe.beta:g}$, $\gamma = {exact.pipe.gamma:g}$"
        label, look = f"{words}: {view.speed(exact.speed, 4)}", {"markerfacecolor": "none"}
        ax.plot(*place, label=label, **open_marker(7.0, markeredgewidth=1.2, zorder=4.0, **look))
    maps = {rf"$\gamma = {gamma:g}$": found for gamma, found in sorted(findings.maps.items())}
    plot.stability_map(maps, map_top(exact), units=_units_of(case.pipe), ax=ax)
    ax.set_xlim(0.0, 1.0)
    ax.set_title(f"Stability boundaries of the continuous pipe, {_flow(case.pipe)}")
    return figure


Draw: TypeAlias = Callable[[Options, Findings], plot.Figure]

FIGURES: dict[str, Draw] = {
    "figure-2-root-loci": loci_figure,
    "figure-3-frequencies": frequency_figure,
    "convergence": convergence_figure,
    "stability-map": map_figure,
}
"""Figures by file name."""


def _panel_figure(
    case: Options,
    findings: Findings,
    picture: Callable[..., Any],
    bar: str,
    across: tuple[float, float],
    top: float,
) -> tuple[plot.Figure, Any]:
    """A figure with a picture of each model and a colour bar; returns it and the bar's Axes."""
    rows, columns = len(findings.panels), max(len(row) for row in findings.panels)
    size = 1.5 + 2.05 * columns, 1.1 + 2.1 * rows
    figure = plot.Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    axes[0, 0].set_xlim(across)
    axes[0, 0].set_ylim(-0.03 * top, 1.04 * top)
    letters = iter(string.ascii_lowercase)
    for (i, j), ax in np.ndenumerate(axes):
        if j >= len(findings.panels[i]):
            ax.set_visible(False)
            continue
        title, loci = findings.panels[i][j]
        ax.set_title(f"({next(letters)}) {title}")
        if loci is None:
            ax.text(0.5, 0.5, "not computed", transform=ax.transAxes, ha="center")
        else:
            picture(loci, bar=False, units=_units_of(case.pipe), ax=ax)
            notes = *textwrap.wrap(loci.missing, 28), _note_range(ax, across, top)
            ax.set_title("", loc="right")  # the title of the panel takes its place
            if note := "\n".join(filter(None, notes)):
                write_inside(ax, note, size=6.5)
        ax.label_outer()
    named = "" if _view(case.pipe).si else "; all quantities nondimensional"
    figure.suptitle(f"{_pipe_title(case.pipe)}{named}", fontsize=9.0, wrap=True)
    return figure, plot.colour_bar(bar, ax=axes)


def _note_range(ax: Any, across: tuple[float, float], top: float) -> str:
    """A note on how far branches extend beyond the axes, which are those of the continuous pipe."""
    (left, right), (_, high) = ax.dataLim.intervalx, ax.dataLim.intervaly
    name = ax.get_xlabel().split("=")[0] + "$" * ("=" in ax.get_xlabel())  # without a definition
    ends = [f"{name} to {end:.3g}" for end in (left, right) if not across[0] <= end <= across[1]]
    if high > 1.04 * top:
        ends.append(f"{ax.get_ylabel()} to {high:.3g}")
    return "\n".join(["outside:", *ends]).replace("-", "\u2212") if ends else ""


def _with_legend(
    case: Options, figure: plot.Figure, findings: Findings, critical: Any, *more: Any
) -> plot.Figure:
    """Adds a legend of the marks below a figure, and returns the figure."""
    handles = []
    if findings.benchmark is not None:
        step = findings.benchmark.speeds[plot.dot_stride(findings.benchmark)]
        label = f"continuous pipe, steps of {_view(case.pipe).speed(float(step), 3)}"
        handles.append(Line2D([], [], label=label, **DOT))
    if findings.exact is not None:
        speed = _view(case.pipe).speed(findings.exact.speed, 4)
        label = f"its critical speed, {speed.replace(' = ', '_c = ')}"
        if findings.exact.unstable_before:
            label = f"its {findings.exact.kind} begins, {speed}; unstable below, too"
        handles.append(Line2D([], [], label=label, **critical))
    handles += [Line2D([], [], label="onset of the model", **ONSET), *more]
    columns = 1 if max(len(row) for row in findings.panels) == 1 else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _ranges(findings: Findings) -> tuple[float, float, float]:
    """Least and greatest real part, and greatest |Im|, that figures 2 and 3 show.

    The values are those of the continuous pipe, or of all panels if it has none, plus a margin.
    """
    every = [loci for row in findings.panels for _, loci in row if loci is not None]
    if findings.benchmark is not None:
        every = [findings.benchmark]
    if not every:
        return -1.0, 1.0, 1.0
    roots = np.concatenate([np.r_[loci.eigenvalues, loci.partners].ravel() for loci in every])
    left, right, top = np.nanmin(roots.real), np.nanmax(roots.real), np.nanmax(roots.imag)
    margin = 0.2 * max(right - left, 1.0)
    return float(left - margin), float(right + margin), float(max(1.05 * top, 1.0))


def _units_of(pipe: Pipe) -> Units:
    """Units of the figures: SI units if the pipe's numbers were given in these."""
    return "nondimensional" if pipe.scales is None else "si"


def _view(pipe: Pipe) -> View:
    return View(_units_of(pipe), pipe)


def _u_text(pipe: Pipe, u: float) -> str:
    """A flow speed in words for a sentence, in the units of the figures."""
    return _view(pipe).speed(u, 5).replace("$", "")


def _pipe_title(pipe: Pipe) -> str:
    return rf"$\beta = {_in_powers(pipe.beta)}$, $\gamma = {_in_powers(pipe.gamma)}$, {_flow(pipe)}"


def _flow(pipe: Pipe) -> str:
    end = rf" ($\alpha = {_in_powers(pipe.alpha)}$)" if pipe.alpha != 1.0 else ""
    damping = rf"damping $\delta = {_in_powers(pipe.damping)}$" if pipe.damping else "undamped"
    return f"{pipe.flow}{end}, {damping}"


def _in_powers(value: float) -> str:
    """A number in mathematics, with a power of ten in place of e-05."""
    digits, _, power = f"{value:.5g}".partition("e")
    return rf"{digits} \times 10^{{{int(power)}}}" if power else digits


def verdict(findings: Findings) -> str:
    """One sentence that says whether the paper's spring rule converges."""
    exact = findings.exact
    if exact is None:
        return "The continuous pipe has no critical speed to compare with."
    if exact.speed == 0.0:
        return "The smallest flow makes the pipe unstable: there is nothing to converge to."
    fitted = convergence_law(_by_family(findings)["rayleigh"], exact)
    if fitted.law == "flat":
        sizes = ", ".join(f"{size:g}" for size in fitted.sizes)
        return (
            "The paper's spring rule (rayleigh) does not converge to the continuous pipe: its "
            f"critical speed tends to {_u_text(exact.pipe, exact.speed * (1.0 + fitted.limit))}, "
            f"{100.0 * fitted.limit:+.2f} % from the exact {_u_text(exact.pipe, exact.speed)} "
            f"(extrapolated from n = {sizes})."
        )
    return "The sizes computed do not show whether the paper's spring rule (rayleigh) converges."


def instabilities(pipe: Pipe, findings: Findings) -> str:
    """Sentences on the speeds at which the continuous pipe is stable, and on its instabilities."""
    exact = findings.exact
    start = ""
    if exact is not None and not exact.stable_at_rest:
        start = "The pipe is buckled at rest. "
    elif exact is not None and exact.speed == 0.0:
        start = "The smallest flow makes the pipe unstable. "
    if findings.crossings is None:
        return f"{start}The instabilities of the continuous pipe were not computed."
    ranges = stable_speeds(Continuum(pipe), findings.crossings, findings.highest)
    parts = [f"from {_u_text(pipe, low)} to {_u_text(pipe, high)}" for low, high in ranges]
    stable = f"stable {' and '.join(parts)}" if parts else "unstable at every speed"
    found = []
    for c in findings.crossings:
        number = _mode(pipe, findings, c)
        words = [c.kind, *([f"mode {number}"] if number else [])]
        words.append("begins" if c.destabilising else "ends")
        beyond = "" if c.unstable_after else "; stable beyond"
        if c.speed > 0.0:
            found.append(f"{_u_text(pipe, c.speed)} ({', '.join(words)}{beyond})")
    listed = textwrap.shorten(", ".join(found), 500, placeholder=" ...") or "none"
    end = _u_text(pipe, findings.highest)
    return f"{start}Up to {end} the continuous pipe is {stable}. Instabilities: {listed}."


def _mode(pipe: Pipe, findings: Findings, found: Crossing) -> str:
    """Number of the mode that crosses; empty where it is a convention, see `is_overdamped`."""
    exact = [] if findings.exact is None else [findings.exact]
    every = (found, *exact, *(findings.crossings or ()))
    return "" if any(is_overdamped(pipe, one.mode) for one in every) else str(found.mode)


def second_mode(exact: CriticalSpeed, rows: Sequence[Row]) -> str:
    """A sentence that says whether the second mode loses stability, in each line of the table."""
    asked = "Is the instability in the second mode (branches counted from rest)?"
    if exact.unstable_before:
        return (
            f"{asked} The pipe has no stability to lose at {_u_text(exact.pipe, exact.speed)}: it "
            "is unstable below, too."
        )
    if is_overdamped(exact.pipe, exact.mode):
        return f"{asked} It comes from modes so damped that they do not oscillate without flow."
    answer = "yes" if exact.mode == 2 else f"no, in mode {exact.mode}"
    modes = [(row, row.critical.mode) for row in rows if row.critical is not None]
    others = [f"{row.family} {row.size} (mode {k})" for row, k in modes if k != exact.mode]
    named = f"; others: {', '.join(others)}" if others else ""
    named = textwrap.shorten(named, 300, placeholder=" ...")
    agree = f"{len(modes) - len(others)} of {len(modes)} models agree"
    return f"{asked} Continuous pipe: {answer}; {agree}{named}."


def _by_family(findings: Findings) -> dict[str, list[CriticalSpeed]]:
    families: dict[str, list[CriticalSpeed]] = {row.family: [] for row in findings.rows}
    for row in findings.rows:
        if row.critical is not None:
            families[row.family].append(row.critical)
    return families


HEADINGS = (
    *("model", "springs or basis", "size", "speed", "frequency", "kind", "mode"),
    *("stable at rest", "error %", "own error", "remark"),
)


def si_header(pipe: Pipe) -> tuple[str, ...]:
    """Headings of the additional columns for a pipe in SI units."""
    if pipe.scales is None:
        return ()
    of_tube = ("flow rate (l/min)",) if pipe.scales.inner_diameter else ()
    return ("speed (m/s)", "frequency (Hz)", *of_tube)


def table(pipe: Pipe, findings: Findings) -> list[tuple[str, ...]]:
    """Rows of the table, the continuous pipe first, with all digits of the numbers."""
    exact = findings.exact
    first = Row("continuous", "", 0 if exact is None else exact.size, exact, findings.remark)
    lines: list[tuple[str, ...]] = []
    for row in (first, *findings.rows):
        start, found = (row.kind, row.family, str(row.size)), row.critical
        si = ("",) * len(si_header(pipe))
        if found is None:
            lines.append((*start, *[""] * 7, row.remark, *si))
            continue
        error, remark = "", row.remark or ("unstable below, too" if found.unstable_before else "")
        if row is not first and exact is not None and exact.speed > 0.0:
            error = f"{100.0 * (found.speed / exact.speed - 1.0):+.6g}"
        speed, rest = repr(found.speed), "yes" if found.stable_at_rest else "no"
        answer = (speed, repr(found.frequency), found.kind, _mode(pipe, findings, found), rest)
        if pipe.scales is not None:
            measured: Any = found.in_si(pipe)
            names = ("speed", "frequency", "flow_rate_l_min")[: len(si)]
            si = tuple(repr(float(getattr(measured, name))) for name in names)
        lines.append((*start, *answer, error, f"{found.error:.1e}", remark, *si))
    return lines


def report(case: Options, findings: Findings) -> str:
    """The text to print: sentences, and the table for the sizes of the panels and the largest."""
    shown = {
        "chain": {*case.chain_sizes, max((*CHAIN_SIZES, *case.chain_sizes))},
        "reduced": {*case.reduced_sizes, max((*REDUCED_SIZES, *case.reduced_sizes))},
    }
    pipe, rows = case.pipe, []
    units: tuple[str, ...] = ("u_c", "omega_c")
    if pipe.scales is not None:
        units = ("V_c (m/s)", "f_c (Hz)", *("Q_c (l/min)" for _ in si_header(pipe)[2:]))
    for kind, family, size, speed, frequency, how, mode, _, *errors in table(pipe, findings):
        errors, answers = errors[:3], errors[3:] or [speed, frequency]
        if kind not in shown or int(size) in shown[kind]:
            digits = zip(answers, (7, 6, 5), strict=False)
            rounded = [f"{float(one):.{count}f}" if one else "" for one, count in digits]
            rows.append((f"{kind} {family}", size, *rounded, how, mode, *errors))
    title = (
        f"Critical speeds: beta = {pipe.beta:g}, gamma = {pipe.gamma:g}, {pipe.flow}, "
        f"alpha = {pipe.alpha:g}, damping = {pipe.damping:g}\n"
    )
    headings = ("model, springs or basis", "size", *units, "kind", "mode", *HEADINGS[-3:])
    notes = ["", verdict(findings), instabilities(pipe, findings)]
    if findings.exact is not None:
        notes.append(second_mode(findings.exact, findings.rows))
    notes.append(
        f"The map's boundaries are within {findings.map_error:.0e} of those of a smaller basis."
    )
    return Table(title, headings, rows, numbers=True, notes=notes).text()
