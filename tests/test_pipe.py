# SPDX-License-Identifier: MIT
"""The pipe's numbers, from SI and back."""

import dataclasses
import math
import pickle

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.models.pipe_numbers import pipe_numbers

HOSE = {
    "length": 0.68,
    "bending_stiffness": 7.4e-3,
    "pipe_mass": 0.194,
    "fluid_mass": 0.0314,
    "gravity": 9.81,
    "drag_coefficient": 1.2,
    "external_diameter": 0.0157,
    "external_density": 1.2,
    "damping_time": 2e-3,
}
DRY = {name: HOSE[name] for name in ("length", "bending_stiffness", "pipe_mass", "fluid_mass")}


def test_units_of_a_pipe_from_si_follow_from_length_mass_and_stiffness():
    pipe = pp.Pipe.from_si(**HOSE)
    mass = HOSE["pipe_mass"] + HOSE["fluid_mass"]
    stiffness, length = HOSE["bending_stiffness"], HOSE["length"]
    assert pipe.beta == pytest.approx(HOSE["fluid_mass"] / mass, rel=1e-15)
    displaced = 1.2 * math.pi * 0.0157**2 / 4
    assert pipe.gamma == pytest.approx(9.81 * length**3 * (mass - displaced) / stiffness, rel=1e-15)
    assert pipe.drag == pytest.approx(1.2 * 1.2 * 0.0157 * length / (2 * mass), rel=1e-14)
    assert pipe.scales.length == length
    assert pipe.scales.mass == pytest.approx(mass, rel=1e-15)
    assert pipe.scales.time == pytest.approx(math.sqrt(mass * length**4 / stiffness), rel=1e-15)
    assert pipe.damping == pytest.approx(2e-3 / pipe.scales.time, rel=1e-15)
    assert pipe.scales.speed == pytest.approx(
        math.sqrt(stiffness / HOSE["fluid_mass"]) / length, rel=1e-15
    )


def test_a_pipe_in_water_is_lifted_by_what_it_displaces_and_moves_some_of_it():
    """The numbers of the pipe in water of physics section 2: gamma (1 - m_w), chi = C_m m_w."""
    water = {"external_diameter": 0.0157, "external_density": 1e3}
    mass = HOSE["pipe_mass"] + HOSE["fluid_mass"]
    share = 1e3 * math.pi * 0.0157**2 / 4 / mass
    assert 0.8 < share < 0.9
    air, wet = pp.Pipe.from_si(**DRY), pp.Pipe.from_si(**DRY, **water)
    assert wet.gamma == pytest.approx(air.gamma * (1.0 - share), rel=1e-13)
    assert (wet.drag, wet.terms) == (0.0, ())
    tank = (0.1**2 + 0.0157**2) / (0.1**2 - 0.0157**2)
    held = pp.Pipe.from_si(**DRY, **water, added_mass_coefficient=tank, drag_coefficient=1.2)
    assert held.gamma == wet.gamma
    assert held.drag == pytest.approx(1.2 * 1e3 * 0.0157 * 0.68 / (2.0 * mass), rel=1e-14)
    [added] = held.terms
    assert added.chi == pytest.approx(share * tank, rel=1e-14)
    assert held.terms_si[0].chi == pytest.approx(1e3 * math.pi * 0.0157**2 / 4 * tank, rel=1e-14)
    water["external_density"] = 1.5e3  # it floats up
    assert pp.Pipe.from_si(**DRY, **water).gamma < 0.0


def test_a_mass_at_the_end_of_a_pipe_that_floats_pulls_it_down():
    """In newtons: the pipe's own weight less the displaced water's, and the whole of the mass's."""
    water = {"external_diameter": 0.02, "external_density": 1e3}
    hose = {"length": 1.0, "bending_stiffness": 0.1, "pipe_mass": 0.1, "fluid_mass": 0.1}
    pipe = pp.Pipe.from_si(**hose, **water, terms=[pp.PointMass(at=1.0, mass=0.05)])
    chain = pp.Chain(pipe, 3)
    lifted = 9.81 * (0.2 - 1e3 * math.pi * 0.02**2 / 4)
    assert lifted < 0.0
    # Turned as one about the clamp, by a unit angle: the moments of both weights, in EI / L.
    moment = (9.81 * 0.05 * 1.0 + lifted * 0.5) / 0.1
    turned = chain.operators().stiffness.sum() - chain.springs[0]
    assert turned == pytest.approx(moment, rel=1e-12)
    assert pp.critical_speed(pp.Continuum(pipe)).stable_at_rest


@pytest.mark.parametrize(
    "part",
    [
        {"external_density": 1e3},
        {"external_diameter": 0.01},
        {"drag_coefficient": 1.0},
        {"added_mass_coefficient": 1.0, "external_density": 1e3},
    ],
)
def test_surroundings_in_part_are_refused(part):
    with pytest.raises(
        ValueError, match="external_diameter and external_density must be given together"
    ):
        pp.Pipe.from_si(**DRY, **part)


def test_the_centrifugal_force_of_a_speed_in_si_is_u_squared_in_units_of_the_beam():
    pipe = pp.Pipe.from_si(**HOSE)
    speed = 11.0
    thrust = HOSE["fluid_mass"] * speed**2 * HOSE["length"] ** 2 / HOSE["bending_stiffness"]
    assert pipe.speed_from_si(speed) ** 2 == pytest.approx(thrust, rel=1e-14)


def test_arrays_convert_elementwise_and_numbers_stay_numbers():
    pipe = pp.Pipe.from_si(**HOSE)
    speeds = pipe.speed_si([0.0, 1.0, 2.0])
    assert isinstance(speeds, np.ndarray)
    np.testing.assert_allclose(speeds, pipe.scales.speed * np.arange(3.0), rtol=1e-15)
    assert type(pipe.speed_from_si(3)) is float


def test_a_pipe_without_gravity_or_surroundings_has_neither_weight_nor_drag():
    pipe = pp.Pipe.from_si(**DRY, gravity=0.0)
    assert (pipe.gamma, pipe.drag, pipe.damping) == (0.0, 0.0, 0.0)
    assert pp.Pipe.from_si(**DRY, gravity=-9.81).gamma == -pp.Pipe.from_si(**DRY).gamma


def test_pipes_with_equal_numbers_are_equal_and_hash_alike():
    one, other = pp.Pipe(0.2, gamma=1), pp.Pipe(beta=0.2, gamma=1.0)
    assert one == other
    assert hash(one) == hash(other)
    assert one != pp.Pipe(0.2, gamma=2.0)
    assert pp.Pipe.from_si(**HOSE) == pp.Pipe.from_si(**HOSE)


def test_a_pipe_is_frozen_and_pickles():
    pipe = pp.Pipe.from_si(**HOSE)
    with pytest.raises(dataclasses.FrozenInstanceError):
        pipe.beta = 0.3
    assert pickle.loads(pickle.dumps(pipe)) == pipe
    assert dataclasses.replace(pipe, flow="aspirating", alpha=0.5).scales == pipe.scales


def test_every_number_of_a_pipe_is_stored_as_a_float():
    pipe = pp.Pipe(np.float32(0.25), gamma=np.int64(3), alpha=1, drag=2, damping=np.array(0.5))
    numbers = (pipe.beta, pipe.gamma, pipe.alpha, pipe.drag, pipe.damping)
    assert numbers == (0.25, 3.0, 1.0, 2.0, 0.5)
    assert {type(number) for number in numbers} == {float}


def test_repr_shows_the_numbers_that_a_pipe_has_and_no_others():
    assert repr(pp.Pipe(0.2)) == "Pipe(beta=0.2)"
    shown = repr(pp.Pipe(0.3, gamma=-1.5, flow="aspirating", alpha=0.5, damping=1e-3))
    assert "drag" not in shown
    same = eval(shown, {"Pipe": pp.Pipe})
    assert same == pp.Pipe(0.3, gamma=-1.5, flow="aspirating", alpha=0.5, damping=1e-3)
    assert "0.68 m" in repr(pp.Pipe.from_si(**HOSE))


def test_drag_has_no_part_in_the_linear_analysis():
    calm, dragged = pp.Pipe(0.2), pp.Pipe(0.2, drag=3.0)
    for make in (lambda pipe: pp.Chain(pipe, 5), lambda pipe: pp.Galerkin(pipe, 5)):
        for a, b in zip(
            make(calm).operators().at(4.0), make(dragged).operators().at(4.0), strict=True
        ):
            np.testing.assert_array_equal(a, b)
    assert (
        pp.critical_speed(pp.Chain(dragged, 5)).speed == pp.critical_speed(pp.Chain(calm, 5)).speed
    )


def test_a_pipe_with_another_number_forgets_what_followed_from_the_first():
    pipe = pp.Pipe(0.2, gamma=10.0)
    assert pipe.axial_gravity == 10.0
    assert pipe_numbers(pipe)["gamma"].changed(pipe, 20.0).axial_gravity == 20.0
