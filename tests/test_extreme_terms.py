# SPDX-License-Identifier: MIT
"""Every law at its least and largest legal numbers, alone and among many, in every model.

Continuous integration runs these on the sanitized core, too: what reads or writes beyond its memory
mostly gives right answers elsewhere.
"""

import dataclasses
from functools import cache

import numpy as np
import pytest
from loaded import LAWS, MAKERS, SPEED, answers, deviations, extremes, states

import pipedyn as pp

pytestmark = pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")

CROWD = tuple(pp.Spring((j + 1) / 16, 1.0) for j in range(15))
"""Many terms, with a panel of a reduced model between each two."""

TAKEN = [(name, law) for name, maker in MAKERS.items() for law in LAWS if maker.takes(law)]

SAME = 1e-6
"""Share by which a batch may miss its states: masses of 1e6 beside 1 take six digits."""


@pytest.mark.parametrize(("name", "law"), TAKEN)
def test_answers_are_finite_and_a_batch_has_those_of_its_states(name, law):
    for term in extremes(law):
        for crowd in ((), CROWD):
            model = MAKERS[name](*crowd, term)
            for what, share in deviations(model, states(model)).items():
                assert share < SAME, (what, term, len(crowd))


@pytest.mark.parametrize("name", MAKERS)
def test_all_laws_act_together_at_every_vector_level(name, each_level):
    taken = [law for law in LAWS if MAKERS[name].takes(law)]
    for end in (0, -1):
        model = MAKERS[name](*CROWD, *(extremes(law)[end] for law in taken))
        assert max(deviations(model, states(model)).values()) < SAME


@pytest.mark.parametrize(("name", "law"), TAKEN)
def test_motions_go_on_or_say_why_they_stop(name, law):
    for term in extremes(law):
        model = MAKERS[name](*CROWD, term)
        try:
            motion = pp.simulate(model, SPEED, 1e-4, lambda s: 1e-3 * s, samples=3, most=100)
        except pp.MotionStopped as stopped:
            motion = stopped.motion
        assert np.isfinite(motion.q).all()
        assert np.isfinite(motion.energy).all()


@cache
def answered(name, crowd):
    """States of a model without the law, one state alone among them, and what is answered."""
    model = MAKERS[name](*crowd)
    y = states(model)
    return [(state, answers(model, state)) for state in (y, y[:, 0].copy())]


@pytest.mark.parametrize(("name", "law"), TAKEN)
def test_a_law_without_strength_changes_nothing(name, law):
    """At a place where another term is: elsewhere a reduced model has one panel more."""
    idle = {item.name: 0.0 for item in dataclasses.fields(law)}
    idle |= {field: own for field, own in (("at", 0.5), ("gap", 0.05)) if field in idle}
    for crowd in (CROWD[7:8], CROWD):
        with_it = MAKERS[name](*crowd, law(**idle))
        for state, expected in answered(name, crowd):
            for what, found in answers(with_it, state).items():
                atol = 1e-15 * np.abs(expected[what]).max()
                np.testing.assert_allclose(found, expected[what], 0.0, atol, False, what)
