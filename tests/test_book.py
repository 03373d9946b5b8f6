# SPDX-License-Identifier: MIT
"""The book: formulas of docstrings, its table of questions, and words that lead to its pages."""

import importlib.util
import inspect
import re
from pathlib import Path

import pytest

import pipedyn as pp

ROOT = Path(__file__).resolve().parents[1]
BOOK = ROOT / "notebooks"
spec = importlib.util.spec_from_file_location("formulas", BOOK / "formulas.py")
formulas = importlib.util.module_from_spec(spec)
spec.loader.exec_module(formulas)


@pytest.mark.parametrize(
    ("text", "tex"),
    [
        ("L^2 sqrt((mu_p + mu_f) / EI)", r"L^{2}\, \sqrt{(\mu_{p} + \mu_{f}) / EI}"),
        ("-stiffness * x^3", r"- \mathit{stiffness} \cdot x^{3}"),
        ("0 < at <= 1", r"0 < \mathit{at} \le 1"),
        ("EI (1 + delta d/dtau)", r"EI\, (1 + \delta\, d / d\tau)"),
        ("1 + |gamma| + a u^2", r"1 + \lvert \gamma \rvert + a\, u^{2}"),
        ("Im lambda > 0", r"\mathrm{Im}\, \lambda > 0"),
        ("q ~ exp(lambda tau)", r"q \sim \exp(\lambda\, \tau)"),
        ("(t - t_i) / (t_{i+1} - t_i)", r"(t - t_{i}) / (t_{i+1} - t_{i})"),
        ("10^-a", "10^{-a}"),
        ("(S, 2)", "(S, 2)"),
        ("(p, m)", "(p, m)"),
        ("omega = -i lambda", r"\omega = -i\, \lambda"),
        ("Re(a * exp(i omega))", r"\mathrm{Re}(a \cdot \exp(i\, \omega))"),
        ("w_i'(s)", "w_{i}'(s)"),
    ],
)
def test_a_formula_of_a_docstring_is_set_as_mathematics(text, tex):
    assert formulas.alone(text) == tex
    assert formulas.marked(f"In the units {text}, as before.") == (
        f"In the units :math:`{tex}`, as before."
    )


@pytest.mark.parametrize(
    "text",
    [
        "a pipe in 3 m of water, at 2 m/s and 10 s later; see e.g. Paidoussis, vol. 1, sec. 5.8",
        "A hose of 1 m, moved every 0.05 s or later, more than 10 s in a chain of 3 kg",
        "the function may be a lambda, and it and/or its pipe's length do not change",
        "shape (count,) with max_speed and inflow_share = 1 given",
        'names such as "beta" and "gamma", with u=0 and count=4 (beta=0.2)',
        ">>> pp.Pipe(beta=0.2, gamma=10.0)\nPipe(beta=0.2, gamma=10)",
        "eqs. (1)-(9) of the paper - and no others",
    ],
)
def test_words_units_and_code_of_a_docstring_stay_as_they_are(text):
    assert formulas.marked(text) == text


def test_powers_of_units_are_set_as_such():
    assert formulas.marked("stiffness in N m^2, load in N/m^3") == "stiffness in N m², load in N/m³"


def test_a_formula_may_run_over_two_lines():
    assert formulas.marked("energy chi\n* v_n^2 / 2 here") == (
        r"energy :math:`\chi \cdot v_{n}^{2} / 2` here"
    )


def test_no_formula_of_a_docstring_is_left_half_set():
    """Brackets are paired within each formula, and no operator stands next to one in the text."""
    found = 0
    modules = (pp, pp.plot, pp.modular, pp.continuation)
    every = {name: getattr(one, name) for one in modules for name in dir(one)}
    for kind in [one for one in every.values() if inspect.isclass(one)]:
        every |= {f"{kind.__name__}.{name}": one for name, one in vars(kind).items()}
    ours = {name: one for name, one in every.items() if not name.split(".")[-1].startswith("_")}
    for name, one in ours.items():
        text = formulas.marked(inspect.getdoc(one) or "")
        for tex in re.findall(":math:`([^`]*)`", text):
            found += 1
            assert tex.count("(") == tex.count(")"), (name, tex)
            assert tex.count("{") == tex.count("}"), (name, tex)
        text = re.sub("``[^`]*``|>>>.*", "[]", text)
        beside = r"[=~+*/] :math:|:math:`[^`]*` [=~+*/] (?![(\[])"
        assert not re.search(beside, text), name
        assert not re.search(r"(\^|\b(sqrt|Re)\()", re.sub(":math:`[^`]*`", "", text)), name
    assert found > 1000


def questions():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text.split("<!-- questions -->")[1].split("<!-- end of questions -->")[0]
    return [row.strip("| ").split(" | ") for row in table.strip().splitlines()[2:]]


def test_the_table_of_questions_names_public_functions_and_pages_of_the_book():
    assert len(questions()) > 10
    for _, functions, page in questions():
        names = re.findall(r"`(\w+)`", functions)
        known = {*pp.__all__} | set(inspect.signature(pp.Pipe).parameters)
        assert names
        assert set(names) <= known
        assert (ROOT / re.fullmatch(r"\[.+\]\((.*)\)", page)[1]).is_file()


def words_of(page):
    """Words of a page's entries in the index."""
    found = re.findall(r"(?:```\{index\}|\.\. index::) (.*)", page.read_text(encoding="utf-8"))
    return [word for entry in found for word in entry.split(", ")]


@pytest.mark.parametrize(
    ("word", "page"),
    [
        ("Argand", "stability"),
        ("natural frequency", "stability"),
        ("buckling", "stability"),
        ("restraint", "terms"),
        ("added mass", "terms"),
        ("power spectrum", "plot"),
        ("Poincare map", "plot"),
        ("horizontal", "models"),
        ("Kelvin-Voigt", "models"),
        ("Hopf", "bifurcation"),
        ("parametric resonance", "driven"),
        ("path following", "continuation"),
        ("Welch", "plot"),
        ("flow rate", "../how-to/my-tube"),
        ("bending stress", "../how-to/my-tube"),
        ("pint", "../how-to/my-tube"),
        ("Julia", "../how-to/hand-over"),
        ("Exudyn", "../how-to/from-exudyn"),
        ("SSMTool", "../how-to/from-ssmtool"),
        ("MatCont", "../how-to/from-matcont"),
        ("BifurcationKit", "../how-to/from-bifurcationkit"),
    ],
)
def test_a_word_of_the_field_leads_to_its_page(word, page):
    assert word in words_of(BOOK / "reference" / f"{page}.md")


def test_a_word_of_the_index_leads_to_one_page():
    every = [word for page in BOOK.glob("*/*.md") for word in words_of(page)]
    assert len(every) > 100
    assert sorted(every) == sorted({*every})
