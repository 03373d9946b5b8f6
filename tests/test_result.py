"""Results compare and hash by their numbers, arrays included."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.util.result import result

PIPE = pp.Pipe(0.2, 10.0, damping=1e-3)
SPEEDS = np.linspace(0.0, 2.0, 3)


def bend(s):
    return 0.1 * s**2


def chain(beta=0.2):
    return pp.Chain(pp.Pipe(beta, 10.0, damping=1e-3, drag=0.3), 3)


MAKERS = {
    "Modes": lambda beta: pp.modes(chain(beta), 3.0),
    "RootLoci": lambda beta: pp.root_loci(chain(beta), SPEEDS, 2),
    "CriticalSpeed": lambda beta: pp.critical_speed(chain(beta)),
    "crossings": lambda beta: pp.crossings(chain(beta), 12.0),
    "StabilityCurve": lambda beta: pp.stability_curve(chain, [beta, 0.3]),
    "a failing point": lambda beta: pp.stability_curve(
        lambda b: pp.Chain(pp.Pipe(b), 1), [beta, 0.3]
    ),
    "CriticalityCurve": lambda beta: pp.criticality_curve(chain, [beta, 0.3]),
    "Hopf": lambda beta: pp.hopf(chain(beta)),
    "Motion": lambda beta: replace(  # what it took depends on what ran before
        pp.simulate(chain(beta), 3.0, 1.0, bend, samples=5), evaluations=0
    ),
    "a member": lambda beta: replace(
        pp.simulate_many(chain(beta), [1.0, 2.0], 1.0, bend, samples=5).motions[1], evaluations=0
    ),
    "Boundary": lambda beta: pp.boundary(
        chain(beta), "gamma", "u", {"gamma": (0.0, 10.0), "u": (0.0, 6.0)}, criticality=False
    ),
    "Branch": lambda beta: pp.continuation.follow(
        lambda x, p: x - beta * p, [0.0], 0.0, (0.0, 1.0)
    ),
    "Equilibria": lambda beta: pp.equilibria(chain(beta), 1.0),
    "Operators": lambda beta: chain(beta).operators(),
    "Power": lambda beta: chain(beta).power(np.full((6, 2), 0.1), 2.0),
}


@pytest.mark.parametrize("name", MAKERS)
def test_results_of_the_same_numbers_are_equal_and_of_others_are_not(name):
    make = MAKERS[name]
    one, again, other = make(0.2), make(0.2), make(0.25)
    assert one == again
    assert hash(one) == hash(again)
    assert pickle.loads(pickle.dumps(one)) == one
    assert one != other
    assert len({one, again, other}) == 2


@result
class Held:
    """For tests."""

    values: np.ndarray
    missing: float = 0.0


same = partial(Held, np.array([1.0, np.nan]))


@pytest.mark.parametrize(
    ("other", "equal"),
    [
        (same(), True),
        (same(-0.0), True),
        (same(np.nan), False),
        (Held(np.array([1.0, 2.0])), False),
        (Held(np.array([[1.0, np.nan]])), False),
        (Held(np.array([1.0, np.nan, 3.0])), False),
        ("text", False),
    ],
)
def test_arrays_compare_by_shape_and_entries(other, equal):
    assert (same() == other) is equal
    assert (other == same()) is equal
    assert not equal or hash(other) == hash(same())


def test_what_is_missing_in_both_is_equal():
    assert same(float("nan")) == same(float("nan"))
    assert hash(same(float("nan"))) == hash(same(float("nan")))
