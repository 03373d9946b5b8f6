# SPDX-License-Identifier: MIT
"""The quick rows of the table of extremes: what holds, and who says where it does not."""

import math

import numpy as np
import pytest
from extremes import SECTIONS, Outcome, cells, judged, row
from independent import chain_newton_step

import pipedyn as pp

pytestmark = pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")  # also extreme ones

REFUSED = {
    "motions": {
        ("MotionStopped", "simulate, a unit of time", "chain n=6", "lengths 1e6 : 1, u=6"),
    },
}
"""What neither double precision nor patience can give, by section, and how that is said."""


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.__name__)
def test_no_answer_at_the_extremes_misleads(section):
    rows = list(section(True))
    assert rows
    refused = [one for one in rows if one.verdict.startswith("refused: ")]
    met = {(one.verdict.split()[1], one.route, one.model, one.at) for one in refused}
    assert met == REFUSED.get(section.__name__, set())
    for one in rows:
        if one not in refused:
            assert one.verdict in ("holds", "says so"), cells(one)
            # An estimate that allows for anything may be had for nothing.
            assert not one.claim > 0.1, cells(one)


@pytest.mark.parametrize(
    ("outcome", "verdict"),
    [
        (Outcome("", 1e-9), "holds"),
        (Outcome("", 1e-7), "MISLEADS"),
        (Outcome("", math.nan), "MISLEADS"),
        (Outcome("", 1e-9, 1e-12), "MISLEADS"),
        (Outcome("", 1e-9, 1e-6), "holds"),
        (Outcome("", 1e-7, 1e-6), "says so"),
        (Outcome("", math.nan, 1e-6), "MISLEADS"),
    ],
)
def test_an_error_beyond_limit_or_estimate_is_called_misleading(outcome, verdict):
    assert judged(outcome, 1e-8) == verdict


def test_a_refusal_is_listed_by_its_name():
    def ask():
        raise pp.NoCrossing("none", 1.0)

    assert row("", "", "", "", ask, lambda _: Outcome("", 0.0)).verdict == "refused: NoCrossing"


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (lambda: pp.Chain(pp.Pipe(0.2), 10), 6.0),
        (lambda: pp.Chain(pp.Pipe(0.2), 100), 100.0),
        (lambda: pp.Chain(pp.Pipe(0.2, damping=1e3), 20), 6.0),
    ],
    ids=["plain", "u = 100", "strongly damped"],
)
def test_stated_errors_bound_the_true_ones_closely(model, u):
    model = model()
    found = pp.modes(model, u, 3)
    assert found.errors.size >= 3  # modes that grow are never left out
    true = [abs(chain_newton_step(model, z, u, 200)) for z in found.eigenvalues]
    assert (true <= found.errors).all()
    assert (found.errors <= 2e-4 * np.abs(found.eigenvalues)).all()


def test_errors_grow_with_the_condition_of_the_eigenvalues():
    slow, fast = (pp.modes(pp.Galerkin(pp.Pipe(0.2), 40), u, 3) for u in (6.0, 100.0))
    assert fast.errors.max() > 1e3 * slow.errors.max()
    assert fast.residuals.max() < 1e-12
