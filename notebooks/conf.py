# SPDX-License-Identifier: MIT
"""The book: `sphinx-build -W notebooks <folder>` with the extra "docs"."""

import importlib.util
import inspect
import re
import sys
from pathlib import Path

from docutils import nodes
from sphinx import addnodes
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util import logging

import pipedyn
from pipedyn.util.result import Result

sys.path.insert(0, str(Path(__file__).parent))
import formulas

project = "pipedyn"
author = "The pipedyn developers"
copyright = "The pipedyn developers"  # the name that Sphinx wants
version = release = pipedyn.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
root_doc = "index"
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
smartquotes_action = "De"  # no quotation marks: q'' is a second derivative
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the text says what each argument is
SHARED = "Result, Saved, TableResult, ResultSequence, Sequence, BaseException, Term, tuple"
# Bases whose members stand once, or belong to Python.

autodoc_default_options = {
    "members": True,
    "inherited-members": SHARED,
    "exclude-members": "law, acts_at_end, needs_held_end",
}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_attr_annotations = False
napoleon_custom_sections = ["Source"]

html_theme = "furo"
html_title = "pipedyn"

# Formulas show without a network: MathJax in one file, with its glyphs, stands beside the pages.
MATHJAX = Path(importlib.util.find_spec("sphinx-mathjax-offline").origin).parent / "static/mathjax"
html_static_path = [str(MATHJAX / "tex-svg.js"), "book.css"]
html_css_files = ["book.css"]
html_theme_options = {"light_css_variables": {"code-font-size": "0.79rem"}}
mathjax_path = "tex-svg.js"

ROOT = Path(__file__).resolve().parent.parent


def source(name, rawtext, text, lineno, inliner, options=None, content=None):
    """The role {source}: a file of the repository, which must be there."""
    if not (ROOT / text).is_file():
        logging.getLogger(__name__).warning(
            "no such file: %s", text, location=(inliner.document.current_source, lineno)
        )
    return [nodes.literal(rawtext, text)], []


INTERNAL = """
archived bounds by_coordinates calls_python cantilevered coordinate_kind core
elastic_operators elastic_scale elastic_share end_guided end_held end_spring equations
free_directions free_states from_elastic from_user frozen has_kinks index initial_state integrated
kinks kinks_known largest_angle law_numbers linear linear_cost motion_jacobian
motion_rates numbers panels place reference require_base require_equilibrium resisted resolution
resolved_modes resting restored sampled series size supported thrust_across tip_place
to_user weight_in
"""
# What the package's own modules ask of pipes, models and terms, by the name of the member.

GIVEN = {"pipedyn.util.result.SI", "pipedyn.Model", "pipedyn.Term"}
# Classes, besides results, whose objects no user makes by hand.


def internal(app, what, name, obj, skip, options):
    """Keeps out of the reference what no user needs."""
    function = getattr(obj, "fget", None) or getattr(obj, "func", None) or obj
    module = getattr(function, "__module__", None) or ""
    return True if name in INTERNAL.split() and module.startswith("pipedyn.models") else None


def called(app, what, name, obj, options, signature, return_annotation):
    """Results are made by the package, which needs no arguments shown; all but one."""
    result = what == "class" and issubclass(obj, Result) and name != "pipedyn.StartPlane"
    return ("", None) if result or name in GIVEN else (signature, return_annotation)


def attributes(lines):
    """The section "Attributes" of a class's docstring: where it stands, and its lines by name."""
    start = stop = lines.index("Attributes:") + 1 if "Attributes:" in lines else len(lines)
    found = {}
    while stop < len(lines) and (lines[stop].startswith(" ") or not lines[stop]):
        if entry := re.match(r"    (\w+(?:, \w+)*): (.*)", lines[stop]):
            names, text = entry.groups()
            several = {name: [f"    {name}: {text}"] for name in names.split(", ")}
            found |= several
        elif lines[stop]:
            for entry in several.values():
                entry.append(lines[stop])
        stop += 1
    return slice(start, stop), found


def with_inherited(app, what, name, obj, options, lines):
    """Fields of a result, those of its bases too, each with an entry of its own."""
    if what != "class" or not issubclass(obj, Result) or obj.__name__ in SHARED.split(", "):
        return
    found = {}
    for base in reversed(obj.__mro__[1:]):
        if base.__module__.startswith("pipedyn") and base.__name__ not in SHARED.split(", "):
            found |= attributes((inspect.getdoc(base) or "").splitlines())[1]
    within, own = attributes(lines)
    entries = [line for entry in (found | own).values() for line in entry]
    if entries:
        heading = [] if "Attributes:" in lines else ["", "Attributes:"]
        lines[within] = [*heading, *entries, ""]


def rejoined(what, lines):
    """Napoleon takes what stands before a colon for a type: prose is put together again."""
    for i, line in enumerate(lines):
        field, _, words = line.partition(": ")
        if field == ":type" and what == "property":
            lines[0] = f"{words}: {lines[0]}"
            del lines[i]
            return
        if field == ":rtype" and " " in words:
            j = next(j for j, one in enumerate(lines) if one.startswith(":returns: "))
            lines[j] = f":returns: {words}: {lines[j].removeprefix(':returns: ')}"
            del lines[i]
            return


def plain_words(app, what, name, obj, options, lines):
    """Docstrings are plain text: what is indented before the lists is a formula or code."""
    rejoined(what, lines)
    text = next((i for i, line in enumerate(lines) if line.startswith((":", ".."))), len(lines))
    found = []
    for paragraph in "\n".join(lines[:text]).split("\n\n"):
        if paragraph.startswith(" "):
            tex = formulas.alone(paragraph)
            found += [".. math::", f"   {tex}"] if tex else [".. code-block:: text", paragraph]
        else:
            found.append(formulas.marked(paragraph))
    lines[:] = "\n\n".join([*found, formulas.marked("\n".join(lines[text:]))]).split("\n")


class Links(SphinxPostTransform):
    """Names of the package in the text, such as `critical_speed` or `plot.boundary`, as links."""

    default_priority = 5  # before references are resolved

    def run(self):
        """Puts each such literal into a reference; one that leads nowhere stays as it is."""
        public = {*pipedyn.__all__}
        for node in [*self.document.findall(nodes.literal)]:
            name = re.sub(r"\(.*\)$", "", node.astext()).removeprefix("pp.")
            known = name.split(".")[0] in public and not isinstance(node.parent, nodes.reference)
            if known and not isinstance(node.parent, addnodes.pending_xref):
                link = addnodes.pending_xref(
                    "", refdomain="py", reftype="obj", reftarget=f"pipedyn.{name}", refwarn=False
                )
                link["refexplicit"] = False
                node.replace_self(link)
                link += node


def setup(app):
    """Registers the above."""
    app.add_role("source", source)
    app.add_post_transform(Links)
    app.connect("autodoc-process-docstring", with_inherited, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", plain_words)
    app.connect("autodoc-process-signature", called)
    app.connect("autodoc-skip-member", internal)
