# SPDX-License-Identifier: MIT
"""Sliders in a notebook that change the numbers of an `Exploration`."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

from pipedyn.models.pipe import OWN_NUMBERS, Pipe
from pipedyn.plot import common
from pipedyn.plot.common import rounded_up
from pipedyn.plot.exploration import Exploration, Slider
from pipedyn.plot.units import Units
from pipedyn.util.errors import PipedynError

GREEK = dict(zip(["alpha", "beta", "gamma", "delta", "kappa", "mu", "psi"], "αβγδκμψ", strict=True))

LABELS = {
    "u": "flow speed u",
    "root.stiffness": "root stiffness",
    **{
        name: f"{one.word} {GREEK.get(one.letter, one.letter)}" for name, one in OWN_NUMBERS.items()
    },
}

SAME_PLACE = "1 / 1 / 2 / 2"
"""Cell of a grid in which the moving pipe lies on top of the pixels."""

STEPS = 300
"""Largest number of steps of a slider; a step is a round number."""


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
    """Sliders for the numbers of a pipe in Jupyter; pictures change while a slider is moved.

    There are sliders for the flow speed, beta, gamma, damping, the number of segments, the
    stiffness of a spring at the root, each number of the pipe's terms, and every other number of
    the pipe that is not at its default. The first picture shows root loci of the chain up to the
    end of the slider of u, and its roots at u. The second shows the stability boundary, which is
    the critical speed against one of the numbers, and the present point. It shows no second range
    of stability above the critical speed, which `boundary` finds. The third picture shows the
    linear motion of the least stable mode, which grows or decays as the mode does. Its amplitude is
    chosen for the picture; `limit_cycle` computes the amplitude that flutter reaches.

    Args:
        pipe: the pipe at first; it must be able to rest straight.
        n: number of segments at first, up to 20.
        u: flow speed at first; 1.05 times the critical speed if not given.
        springs: rule for the springs, as for `Chain`.
        against: the number against which critical speeds are drawn; it must have a slider.
        ranges: ranges (low, high) of sliders by name, in place of the usual ones; a number of the
            pipe that is named here gets a slider.
        units: units of the pictures, "nondimensional", or "si" if the pipe has scales. Sliders show
            nondimensional numbers, and the sentences below the sliders both units.

    Returns:
        The widget, which Jupyter shows. Its attribute `exploration` is the `Exploration` with the
        present numbers, the model and its answers.

    Example:
        >>> plot.explore(pp.Pipe(0.2, gamma=10.0, damping=0.01))  # doctest: +SKIP

    Raises:
        ImportError: if ipywidgets, which is in the extra "notebook", is not installed.
        ValueError, TypeError: for bad arguments, as for `Exploration`.
    """
    try:
        import ipywidgets as widgets
    except ImportError as error:
        raise ImportError(
            'plot.explore needs ipywidgets, which the extra "notebook" brings: '
            "pip install pipedyn[notebook]"
        ) from error
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
        name, whole = slider.name, slider.name == "segments"
        made = (widgets.IntSlider if whole else widgets.FloatSlider)(
            int(state.values[name]) if whole else state.values[name],
            min=slider.low,
            max=slider.high,
            step=1 if whole else rounded_up((slider.high - slider.low) / STEPS),
            readout_format="d" if whole else ".4g",
            description=LABELS.get(name, name),
            style={"description_width": "105px"},
            layout=widgets.Layout(width="auto"),
        )
        made.observe(lambda change: follow(name, change), "value")
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


def _as_html(state: Exploration, trouble: str) -> str:
    """The report of an exploration as HTML, with an error message if there is one."""
    now, then = (html.escape(one) for one in state.report)
    colour = common.VERMILION if state.unstable else common.GREEN
    said = f'<b style="color:{colour}">{now}</b><br>{then}'
    if trouble:
        said += f'<br><span style="color:{common.VERMILION}">{html.escape(trouble)}</span>'
    return f'<div style="line-height:1.35;padding:2px 0">{said}</div>'
