# SPDX-License-Identifier: MIT
"""Newton's method: when it ends, and with what."""

import numpy as np
import pytest

from pipedyn.util.newton import NewtonFailed, newton


def root_of_two(x):
    change = (2.0 - x * x) / (2.0 * x)
    return change, abs(change)


def test_it_converges_to_rounding_in_a_few_steps():
    found = newton(1.0, root_of_two, tolerance=1e-12, iterations=6)
    assert found == pytest.approx(np.sqrt(2.0), rel=1e-15)


def test_steps_are_shortened_to_the_longest_allowed():
    iterates = []

    def recorded(x):
        iterates.append(x)
        return root_of_two(x)

    newton(100.0, recorded, tolerance=1e-12, longest=10.0, iterations=50)
    assert np.abs(np.diff(iterates)).max() <= 10.0
    assert iterates[1] == 90.0


def test_steps_that_only_rounding_keeps_up_end_it():
    def noisy(x):
        return 1.0 - x + 1e-9, max(abs(1.0 - x), 1e-9)

    with pytest.raises(NewtonFailed, match="did not converge"):
        newton(0.0, noisy, tolerance=1e-12)
    assert newton(0.0, noisy, tolerance=1e-12, stagnation=1e-8) == pytest.approx(1.0)


def test_a_failure_says_why():
    def refuse(x):
        if x > 3.0:
            raise NewtonFailed("too far")

    with pytest.raises(NewtonFailed, match="too far"):
        newton(0.0, lambda x: (1.0, 1.0), tolerance=0.5, check=refuse)
    with pytest.raises(NewtonFailed, match="not finite"):
        newton(1.0, lambda x: (np.nan, np.nan), tolerance=1e-9)
    with pytest.raises(NewtonFailed, match="singular"):
        newton(np.ones(1), lambda x: (np.linalg.solve([[0.0]], x), 1.0), tolerance=1e-9)
    with pytest.raises(NewtonFailed, match="did not converge"):
        newton(0.0, lambda x: (1.0, 1.0), tolerance=1e-9, patience=3)
