# SPDX-License-Identifier: MIT
"""A still copy of `plot.explore` for a page without Python: some values of one slider, computed."""

import base64
import html
import io
import json

from IPython.display import HTML
from PIL import Image

PAGE = """
<div class="knob" style="overflow-x:auto">
<label style="display:flex;gap:0.8em;align-items:center;flex-wrap:wrap">NAME
<input type="range" min="0" max="LAST" value="FIRST" step="1" style="flex:1;min-width:9em">
</label>
<p class="said" style="margin:0.3em 0;min-height:3.2em">SAID</p>
<div style="display:grid;min-width:640px;background:white">
<img alt="root loci, stability boundary and moving pipe" style="grid-area:1/1/2/2;width:100%"
 src="data:image/png;base64,PIXELS">
<img alt="" style="grid-area:1/1/2/2;width:100%" src="data:image/svg+xml;base64,FILM">
</div>
<script>
(() => {
  const here = document.currentScript.parentElement, frames = FRAMES;
  const said = here.querySelector(".said"), [pixels, film] = here.querySelectorAll("img");
  here.querySelector("input").addEventListener("input", event => {
    const frame = frames[event.target.value];
    said.innerHTML = frame.said;
    pixels.src = "data:image/png;base64," + frame.pixels;
    film.src = "data:image/svg+xml;base64," + frame.film;
  });
})();
</script>
</div>
"""


def frame(state):
    """What is shown of an `Exploration` as its numbers are set: text, pixels and film."""
    picture = Image.open(io.BytesIO(state.picture.png())).quantize(96)
    file = io.BytesIO()
    picture.save(file, "png")
    now, then = (html.escape(one) for one in state.report)
    return {
        "said": f"<b>{now}</b><br>{then}",
        "pixels": base64.b64encode(file.getvalue()).decode(),
        "film": base64.b64encode(state.picture.overlay().encode()).decode(),
    }


def knob(state, name, label, values):
    """A slider of HTML over the values of one number; it shows the last but a quarter at first."""
    frames = []
    for value in values:
        state.set(name, value)
        frames.append(frame(state))
    first = (3 * len(frames)) // 4
    words = {
        "NAME": html.escape(label),
        "LAST": str(len(frames) - 1),
        "FIRST": str(first),
        "SAID": frames[first]["said"],
        "PIXELS": frames[first]["pixels"],
        "FILM": frames[first]["film"],
        "FRAMES": json.dumps(frames).replace("</", "<\\/"),
    }
    page = PAGE
    for word, text in words.items():
        page = page.replace(word, text, 1)
    return HTML(page)
