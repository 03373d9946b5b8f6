# SPDX-License-Identifier: MIT
"""`explore`: the sliders of a notebook over an `Exploration`."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from typing import Any

from pipedyn.models.base import PipedynError
from pipedyn.models.pipe import Pipe
from pipedyn.plot import common
from pipedyn.plot.exploration import Exploration, Slider
from pipedyn.plot.units import Units

LABELS = {
    "u": "flow speed u",
    "beta": "mass ratio β",
    "gamma": "gravity γ",
    "damping": "damping δ",
    "alpha": "end coefficient α",
    "hysteresis": "loss factor μ",
    "inflow_share": "inflow share c",
    "root.stiffness": "root stiffness",
}

SAME_PLACE = "1 / 1 / 2 / 2"
"""The cell of a grid in which pixels and the moving pipe lie over one another."""

STEPS = 200
"""Of a slider at least; its step is 1, 2 or 5 times a power of ten."""


def explore(
    pipe: Pipe,
    n: int = 10,
    u: float | None = None,
    *,
    springs: str = "consistent",
    against: str = "beta",
    ranges: Mapping[str, tuple[float, float]] | None = None,
    units: Units = "nondimensional",
) -> Any:
    """Sliders for a pipe's numbers in Jupyter; pictures follow while one is moved.

    There is a slider for the flow speed, beta, gamma, damping, the number of segments, the
    stiffness of a root that gives, each number of the pipe's terms and whatever else of it is not
    at its default. The pictures are the root loci of the chain up to the end of the slider of u,
    with its roots at u; the stability boundary, the critical speed against one of the numbers, with
    the place that is set; and the pipe's motion. That is the linear motion of the least stable
    mode, which grows or decays as the mode does; its size is chosen for the picture. The amplitude
    that flutter reaches is not in it, see `limit_cycle`. Above the critical speed no second range
    of stability is looked for, see `boundary`.

    Args:
        pipe: the pipe at first; the straight one must be an equilibrium.
        n: number of segments at first, up to 20.
        u: flow speed at first; 1.05 times the critical one where not given.
        springs: rule for the springs, as for `Chain`.
        against: the number against which critical speeds are drawn, one that has a slider.
        ranges: (low, high) of sliders by name, where others than the usual are wanted; a number of
            the pipe that is named here gets a slider.
        units: of the pictures, "nondimensional", or "si" where the pipe has scales; sliders are of
            nondimensional numbers, the sentences below them tell both.

    Returns:
        The widget, which Jupyter shows; its attribute `exploration` holds the numbers as they are
        set, the model and its answers, see `Exploration`.

    Example:
        >>> plot.explore(pp.Pipe(0.2, gamma=10.0, damping=0.01))  # doctest: +SKIP

    Raises:
        ImportError: without ipywidgets, which is in the extra "notebook".
        ValueError, TypeError: for bad arguments, as of `Exploration`.
    """
    widgets = _ipywidgets()
    state = Exploration(pipe, n, u, springs=springs, against=against, ranges=ranges, units=units)
    cell = widgets.Layout(grid_area=SAME_PLACE, width="100%", margin="0")
    pixels = widgets.Image(format="png", layout=cell)
    moving = widgets.Image(format="svg+xml", layout=cell)
    text = widgets.HTML()

    def show(trouble: str = "") -> None:
        pixels.value, moving.value = state.picture.png(), state.picture.overlay().encode()
        text.value = _as_html(state, trouble)

    def follow(name: str, change: Mapping[str, Any]) -> None:
        try:
            state.set(name, change["new"])
            show()
        except (ValueError, PipedynError) as error:
            text.value = _as_html(state, f"No answer for {name} = {change['new']:g}: {error}")

    def control(slider: Slider) -> Any:
        made = _slider(widgets, slider, state.values[slider.name])
        made.observe(lambda change: follow(slider.name, change), "value")
        return made

    show()
    columns = "repeat(auto-fill, minmax(270px, 1fr))"
    every = widgets.GridBox(
        [control(one) for one in state.sliders],
        layout=widgets.Layout(grid_template_columns=columns, width="100%"),
    )
    stack = widgets.GridBox([pixels, moving], layout=widgets.Layout(width="100%"))
    box = widgets.VBox([every, text, stack], layout=widgets.Layout(max_width="1060px"))
    box.exploration = state
    return box


def _ipywidgets() -> Any:
    try:
        import ipywidgets
    except ImportError as error:
        raise ImportError(
            'plot.explore needs ipywidgets, which the extra "notebook" brings: '
            "pip install pipedyn[notebook]"
        ) from error
    return ipywidgets


def _slider(widgets: Any, slider: Slider, value: float) -> Any:
    """The widget of a number."""
    label = LABELS.get(slider.name, slider.name)
    look = {
        "description": label,
        "style": {"description_width": "105px"},
        "layout": widgets.Layout(width="auto"),
        "continuous_update": True,
    }
    if slider.name == "segments":
        return widgets.IntSlider(int(value), min=int(slider.low), max=int(slider.high), **look)
    step = step_of(slider)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    bounds = {"min": slider.low, "max": slider.high, "step": step}
    return widgets.FloatSlider(value, readout_format=f".{digits}f", **bounds, **look)


def step_of(slider: Slider) -> float:
    """The largest of 1, 2, 5 times a power of ten that makes enough steps."""
    finest = (slider.high - slider.low) / STEPS
    power = 10.0 ** math.floor(math.log10(finest))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= finest * (1.0 + 1e-9))


def _as_html(state: Exploration, trouble: str) -> str:
    """The state in words, as HTML."""
    now, then = (html.escape(one) for one in state.report)
    colour = common.VERMILION if state.unstable else common.GREEN
    said = f'<b style="color:{colour}">{now}</b><br>{then}'
    if trouble:
        said += f'<br><span style="color:{common.VERMILION}">{html.escape(trouble)}</span>'
    return f'<div style="line-height:1.35;padding:2px 0">{said}</div>'
