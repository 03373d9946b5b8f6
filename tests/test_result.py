"""Results compare and hash by their numbers, arrays included."""

import pickle
import sys
from dataclasses import fields, replace
from functools import cache, partial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pipedyn as pp

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
    "CriticalSpeeds": lambda beta: pp.critical_speeds(chain(beta), {"gamma": [0.0, 1.0]}),
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


def test_what_was_drawn_pickles():
    """What a picture has computed, and kept, is left out."""
    found = pp.boundary(
        SCALED_CHAIN, "gamma", "u", {"gamma": (0.0, 5.0), "u": (0.0, 8.0)}, criticality=False
    )
    before = pickle.dumps(found)
    assert found.unstable(1.0, 1.0) == 0  # keeps its matrices
    assert len(found.__dict__) > len(found.__getstate__())
    assert pickle.dumps(found) == before
    assert pickle.loads(before).unstable(1.0, 1.0) == 0


def held(blocks, value=0.0):
    """A result with an array and a number."""
    none = np.zeros(0)
    return pp.LyapunovExponent(value, 0.1, blocks, none, none, 1.0, none)


same = partial(held, np.array([1.0, np.nan]))


@pytest.mark.parametrize(
    ("other", "equal"),
    [
        (same(), True),
        (same(-0.0), True),
        (same(np.nan), False),
        (held(np.array([1.0, 2.0])), False),
        (held(np.array([[1.0, np.nan]])), False),
        (held(np.array([1.0, np.nan, 3.0])), False),
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


# ------------------------------------------------------------------------------ what users see


HOSE = {"length": 0.45, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.032}
SCALED = pp.Pipe.from_si(**HOSE)
SCALED_CHAIN = pp.Chain(SCALED, 3)


PUBLIC = [getattr(part, name) for part in (pp, pp.continuation) for name in part.__all__]
TABLES = {one for one in PUBLIC if isinstance(one, type) and hasattr(one, "to_dataframe")}


@cache
def tables():
    """One of each class of tables, of a pipe with scales."""
    event = pp.Event(lambda t, q, qdot: q[0])
    motion = pp.simulate(SCALED_CHAIN, 4.0, 1.0, bend, samples=5, events=event, dense=True)
    small = pp.Chain(SCALED, 2)
    cycle = pp.limit_cycle(small, 6.0)
    diagram = pp.bifurcation_diagram(small, [5.0, 5.2], cycles=8)
    shaken = pp.forced_response(
        pp.Chain(pp.Pipe.from_si(**HOSE, damping_time=0.01), 2),
        1.0,
        base=pp.Harmonic(0.01, 10.0),
        frequencies=(9.0, 11.0),
    )
    pulsation = pp.Pulsation(2.0, 0.3, 25.0)
    whirling = pp.Chain(SCALED, 2, dimensions=3)
    circles = pp.bifurcation_diagram(whirling, [5.0, 5.2], cycles=4).rotating[0]
    return [
        circles,
        motion,
        motion.events[0],
        pp.simulate_many(SCALED_CHAIN, [1.0, 2.0], 1.0, bend, samples=5),
        pp.modes(SCALED_CHAIN, 2.0),
        pp.crossings(SCALED_CHAIN, 9.0),
        replace(pp.root_loci(SCALED_CHAIN, SPEEDS, 2)),
        pp.stability_curve(lambda n: pp.Chain(SCALED, round(n)), [3.0, 4.0]),
        pp.critical_speeds(SCALED_CHAIN, {"gamma": [0.0, 1.0]}),
        pp.criticality_curve(lambda n: pp.Chain(SCALED, round(n)), [3.0, 4.0]),
        pp.frequency_response(SCALED_CHAIN, 1.0, [1.0, 2.0]),
        pp.lyapunov_exponent(small, 4.0, bend, duration=5.0, transient=1.0),
        pp.equilibria(small, 1.0),
        cycle,
        diagram,
        diagram.equilibria[0],
        diagram.cycles[0],
        pp.boundary(small, "gamma", "u", {"gamma": (0.0, 5.0), "u": (0.0, 8.0)}),
        pp.continuation.follow(lambda x, p: x - p, [0.0], 0.0, (0.0, 1.0)),
        shaken,
        shaken.branches[0],
        shaken.at(10.0)[0],
        pp.attractors(small, 3.0, 2),
        regions(),
        regions()[0],
        pp.floquet(small, pulsation),
        pp.trade(SCALED, "critical_speed", families="beam", sizes=[4], repeats=1),
        pp.relevant(pp.Pipe(0.2), 1.0, "frequencies", count=1),
        pp.identify(SCALED, [pp.Measurement("frequency", 1.0, 0.01)], ["bending_stiffness"]),
        cycle_fold(),
    ]


@cache
def regions():
    return pp.parametric_regions(pp.Chain(pp.Pipe(0.1, 3.0), 2), 3.0, [0.6], (11.0, 20.0))


def cycle_fold():
    branch = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.05), 2), [3.0, 3.2, 3.4]).cycles[0]
    fold = next(event for event in branch.events if event.kind == "fold")
    window = {"beta": (0.04, 0.06), "u": (2.0, 5.0)}
    return pp.cycle_boundary(branch, fold, "beta", "u", window)


def test_every_table_has_columns_a_data_frame_a_page_and_a_file_and_pickles(tmp_path):
    every = tables()
    assert {type(table) for table in every} == TABLES
    assert len(TABLES) > 25
    for table in every:
        assert pickle.loads(pickle.dumps(table)) == table
        table.save(tmp_path / "table.npz")
        loaded = pp.load(tmp_path / "table.npz")
        assert loaded == table
        assert repr(loaded) == repr(table)
        columns = table.columns()
        assert len({len(values) for values in columns.values()}) == 1, table
        frame = table.to_dataframe()
        assert list(frame.columns) == list(columns)
        assert table.to_csv().splitlines()[0] == ",".join(columns)
        assert len(table.to_csv().splitlines()) == 1 + len(frame)
        assert table._repr_html_().startswith("<table>")
        most = 1 if isinstance(table, pp.Motion) else 5
        assert len(repr(table).splitlines()) <= most, repr(table)
        if table._scales() is None:
            with pytest.raises(ValueError, match=r"pipe must be given|numbers in SI need"):
                table.columns("si")
        else:
            assert len(table.columns("si")) == len(columns)


def within(one):
    """All results that a result holds."""
    for name in (field.name for field in fields(one)):
        value = getattr(one, name)
        for part in value if isinstance(value, tuple) else (value,):
            if hasattr(part, "in_si"):
                yield part
                yield from within(part)


def test_reprs_are_short():
    shown = {type(part): part for table in tables() for part in (table, *within(table))}
    others = [
        pp.critical_speed(SCALED_CHAIN),
        pp.hopf(SCALED_CHAIN),
        pp.choose(SCALED, "critical_speed", tolerance=0.1),
        SCALED_CHAIN.operators(),
        SCALED_CHAIN.power(np.zeros(6), 1.0),
    ]
    shown |= {type(one): one for one in others}
    assert len(shown) > 40
    for one in shown.values():
        lines = repr(one).splitlines()
        assert len(lines) <= 5, repr(one)
        assert max(map(len, lines)) <= 160, repr(one)


def test_numbers_in_si_are_those_of_the_hose():
    """Against the definitions with the hose's own numbers, and between one another."""
    length, stiffness, fluid = HOSE["length"], HOSE["bending_stiffness"], HOSE["fluid_mass"]
    mass = HOSE["pipe_mass"] + fluid
    found = pp.critical_speed(SCALED_CHAIN)
    si = found.in_si()
    assert si.speed == pytest.approx(found.speed * np.sqrt(stiffness / fluid) / length, rel=1e-14)
    time = length**2 * np.sqrt(mass / stiffness)
    assert si.frequency == pytest.approx(found.frequency / (2.0 * np.pi * time), rel=1e-14)
    assert si.units == {"speed": "m/s", "frequency": "Hz", "error": "m/s"}
    shown = f"speed={si.speed:.7g} m/s, frequency={si.frequency:.7g} Hz, error={si.error:.7g} m/s"
    assert repr(si) == f"CriticalSpeed in SI({shown}, sensitivity=<Sensitivity>)"
    assert si.discretisation == pytest.approx(si.speed * found.discretisation / found.speed)
    assert pp.critical_speed(pp.Chain(SCALED, 2, springs=[2.0, 2.0])).in_si().discretisation is None
    assert pickle.loads(pickle.dumps(si)).speed == si.speed
    with pytest.raises(AttributeError, match="mode of CriticalSpeed has no value in SI units"):
        _ = si.mode
    cycle = pp.limit_cycle(pp.Chain(SCALED, 2), 6.0).in_si()
    assert cycle.period == pytest.approx(1.0 / cycle.frequency, rel=1e-12)
    assert cycle.t[-1] == pytest.approx(cycle.period, rel=1e-12)
    assert np.ptp(cycle.tip[:, 0]) == pytest.approx(2.0 * cycle.amplitude, rel=1e-3)
    # The rates of coordinates are their derivatives by time in seconds.
    slope = np.gradient(pp.limit_cycle(pp.Chain(SCALED, 2), 6.0).q[:, 0], cycle.t, edge_order=2)
    assert np.abs(slope - cycle.qdot[:, 0]).max() < 0.02 * np.abs(slope).max()


def test_sensitivities_in_si_are_differences_of_speeds_and_frequencies_in_si():
    """The number of a hose is changed, and its critical speed computed again."""

    hose = pp.Pipe.from_si(**HOSE, damping_time=0.01)

    def critical(**changes):
        return pp.critical_speed(pp.Chain(replace(hose, **changes), 3)).in_si()

    found = critical().sensitivity
    for name in ("gamma", "damping", "beta"):
        value, step = getattr(hose, name), 1e-4 * getattr(hose, name)
        low, high = (critical(**{name: value + side * step}) for side in (-1.0, 1.0))
        changed = (high.frequency - low.frequency) / (2.0 * step)
        assert getattr(found.frequency, name) == pytest.approx(changed, rel=1e-5)
        if name != "beta":
            changed = (high.speed - low.speed) / (2.0 * step)
            assert getattr(found.speed, name) == pytest.approx(changed, rel=1e-5)
    with pytest.raises(AttributeError, match="beta of Derivatives has no value in SI units"):
        _ = found.speed.beta  # the unit of flow speed changes with it


def test_power_in_watts_is_energy_in_joules_by_seconds():
    """Of a damped hose without flow, along its motion."""
    model = pp.Chain(pp.Pipe.from_si(**HOSE, damping_time=0.02), 3)
    motion = pp.simulate(model, 0.0, 0.02, bend, [1.0, 0.0, 0.0], rtol=1e-12)
    si, slope = motion.in_si(), CubicSpline(motion.in_si().t, motion.in_si().energy).derivative()
    powers = model.power(motion.y, 0.0).in_si(model.pipe).total
    np.testing.assert_allclose(powers, slope(si.t), atol=1e-6 * np.abs(powers).max())


def test_maxima_in_a_period_are_a_number_without_a_unit():
    turnings = np.array([0.5, -0.5])
    motion = pp.Attractor(6.0, 0, "periodic", period=1, turnings=turnings, end=np.zeros(4))
    si = motion.in_si(SCALED)
    np.testing.assert_array_equal(si.turnings, 0.45 * turnings)
    with pytest.raises(AttributeError, match="period of Attractor has no value in SI units"):
        _ = si.period


def test_reprs_tell_what_was_asked_for():
    curve = pp.stability_curve(lambda n: pp.Chain(SCALED, round(n)), [2.0, 3.0])
    assert f"speeds=[{curve.speeds[0]:.7g}, {curve.speeds[1]:.7g}]" in repr(curve)
    found = pp.simulate_many(SCALED_CHAIN, [1.0, 2.0], 1.0, bend, samples=5)
    assert repr(found.in_si()) == "Ensemble in SI(motions=<2 Motion>)"
    assert "crossings" not in repr(pp.crossings(SCALED_CHAIN, 9.0))
    assert repr(pp.crossings(SCALED_CHAIN, 9.0)).startswith("Crossings(speeds=[")


def test_crossings_are_a_tuple_and_a_table():
    model = pp.Continuum(pp.Pipe(0.295))
    found = pp.crossings(model, 9.0)
    first, *others = found
    assert len(found) == 3
    assert (first, others) == (found[0], [found[1], found[-1]])
    assert found[1:] == tuple(others)
    assert first in found
    np.testing.assert_array_equal(found.to_dataframe()["speed"], found.speeds)
    assert not pp.crossings(model, 1.0)
    hose = pp.crossings(SCALED_CHAIN, 9.0)
    assert hose.in_si()[0].speed == hose.in_si().speeds[0] == SCALED.speed_si(hose[0].speed)
    assert hose.columns("si")["speed (m/s)"][0] == hose.in_si().speeds[0]


def test_parametric_regions_are_a_tuple_and_a_table():
    found = regions()
    columns = found.columns()
    assert len(found) == len(set(columns["region"])) > 1
    for index, one in enumerate(found):
        np.testing.assert_array_equal(
            columns["highest"][columns["region"] == index], one.edges[:, 1]
        )
    none = pp.parametric_regions(pp.Chain(pp.Pipe(0.1, 3.0), 2), 1.0, 0.01, (50.0, 60.0))
    assert list(none.columns()) == list(columns)


def test_energy_in_joules_is_weight_times_height():
    """What gravity adds to the energy of a bent pipe, from the heights of its segments."""
    weightless = pp.Pipe.from_si(**HOSE, gravity=0.0)
    angles = np.array([0.3, -0.2, 0.5])
    heavy, light = (
        pp.simulate(pp.Chain(pipe, 3), 0.0, 1e-3, angles).in_si().energy[0]
        for pipe in (SCALED, weightless)
    )
    part, weight = HOSE["length"] / 3.0, 9.81 * (HOSE["pipe_mass"] + HOSE["fluid_mass"])
    joints = np.append(0.0, np.cumsum(part * (1.0 - np.cos(angles))))
    assert heavy - light == pytest.approx(
        weight * part * 0.5 * (joints[1:] + joints[:-1]).sum(), rel=1e-5
    )


def test_a_sweep_over_the_length_has_scales_of_each_point():
    def hose(length):
        return pp.Chain(pp.Pipe.from_si(**{**HOSE, "length": length}), 3)

    curve = pp.stability_curve(hose, [0.3, 0.45])
    single = [pp.critical_speed(hose(length)).in_si().speed for length in (0.3, 0.45)]
    np.testing.assert_allclose(curve.in_si().speeds, single, rtol=1e-12)
    np.testing.assert_allclose(curve.columns("si")["speed (m/s)"], single, rtol=1e-12)
    assert [one.in_si().speed for one in curve.critical] == pytest.approx(single, rel=1e-12)


def test_a_sweep_without_an_answer_has_its_pipes(tmp_path):
    """A chain of one segment never flutters: no answer of its own holds the pipe."""

    def hose(length):
        return pp.Chain(pp.Pipe.from_si(**{**HOSE, "length": length}), 1)

    ends = np.array([SCALED.speed_si(100.0) * 0.45 / length for length in (0.3, 0.45)])
    for curve in (
        pp.stability_curve(hose, [0.3, 0.45]),
        pp.stability_curve(hose, [0.3, 0.45], max_speed=100.0),
    ):
        curve.save(tmp_path / "curve.npz")
        saved = pp.load(tmp_path / "curve.npz")
        assert saved == curve
        assert saved.pipes == (hose(0.3).pipe, SCALED)
        np.testing.assert_allclose(saved.in_si().no_loss_up_to, ends, rtol=1e-12)
        assert np.isnan(saved.columns("si")["speed (m/s)"]).all()
    none = pp.criticality_curve(hose, [0.3, 0.45])
    assert none.pipes == (hose(0.3).pipe, SCALED)
    assert np.isnan(none.in_si().speeds).all()
    half = pp.stability_curve(lambda n: pp.Chain(SCALED, 1 if n == 2.0 else n), [1.5, 2.0])
    assert half.pipes == (None, SCALED)


def test_an_exponent_has_its_pipe():
    found = pp.lyapunov_exponent(SCALED_CHAIN, 2.0, duration=2.0, transient=0.0, blocks=4)
    assert found.pipe == SCALED
    assert found.in_si().value == pytest.approx(found.value / SCALED.scales.time)
    assert "t (s)" in found.columns("si")


def test_the_axes_of_a_boundary_have_the_units_of_its_numbers():
    pipe = pp.Pipe.from_si(**HOSE, terms=[pp.PointMass(0.45, 0.01)])
    window = {"PointMass.mass": (0.05, 0.2), "u": (0.0, 9.0)}
    found = pp.boundary(pp.Chain(pipe, 3), "PointMass.mass", "u", window, criticality=False)
    curve, si = found.curves[0], found.in_si().curves[0]
    scale = 0.45 * (HOSE["pipe_mass"] + HOSE["fluid_mass"])
    np.testing.assert_allclose(si.x, curve.x * scale, rtol=1e-12)
    np.testing.assert_allclose(si.y, pipe.speed_si(curve.y), rtol=1e-12)
    assert list(found.columns("si"))[2:5] == ["PointMass.mass (kg)", "u (m/s)", "frequency (Hz)"]


def test_si_is_refused_without_scales_and_without_a_pipe():
    with pytest.raises(ValueError, match=r"numbers in SI need a pipe made with Pipe\.from_si"):
        pp.critical_speed(chain()).in_si()
    loci = replace(pp.root_loci(SCALED_CHAIN, SPEEDS, 2), pipe=None)
    with pytest.raises(ValueError, match="pipe must be given: RootLoci does not hold its pipe"):
        loci.in_si()
    with pytest.raises(TypeError, match="pipe must be a Pipe, got 3"):
        loci.in_si(3)
    np.testing.assert_array_equal(loci.in_si(SCALED).speeds, SCALED.speed_si(SPEEDS))
    with pytest.raises(ValueError, match="units must be one of 'nondimensional', 'si', got 'SI'"):
        loci.columns("SI")


def test_a_data_frame_needs_pandas(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        pp.modes(SCALED_CHAIN, 2.0).to_dataframe()


def test_a_motion_is_shown_in_a_line_and_a_diagram_in_five():
    motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 3), 1.0, 1.0, bend, samples=5)
    assert repr(motion) == (
        "Motion(t=[0, 0.25, 0.5, 0.75, 1], u=1, "
        "model=Chain(Pipe(beta=0.2), n=3, springs='consistent'))"
    )
    motion = pp.simulate(
        pp.Chain(SCALED, 3), pp.Pulsation(1.0, 0.1, 3.0), 1.0, bend, base=pp.Harmonic(0.01, 3.0)
    )
    assert repr(motion) == "Motion(t=<501, 0 to 1>, u=Pulsation(...), model=Chain(...))"
    diagram = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2), 2), [3.0, 4.0], cycles=6)
    assert len(repr(diagram).splitlines()) <= 5
    assert "cycles=<2 CycleBranch>" in repr(diagram)


HEAVY = {**HOSE, "pipe_mass": 0.122, "fluid_mass": 0.1}
"""The same mass in all, more of it fluid."""


def test_another_mass_ratio_has_another_unit_of_speed():
    """Of a pipe that was changed, and along a boundary over beta; against pipes made so."""
    changed, made = replace(SCALED, beta=0.1 / 0.222), pp.Pipe.from_si(**HEAVY)
    assert changed.scales == pytest.approx(made.scales, rel=1e-12)
    window = {"beta": (0.1, 0.5), "u": (0.0, 9.0)}
    found = pp.boundary(pp.Chain(SCALED, 3), "beta", "u", window, criticality=False)
    columns, curve = found.columns("si"), found.in_si().curves[0]
    for place in (0, -1):
        mass = 0.222 * found.curves[0].x[place]
        hose = pp.Pipe.from_si(**{**HOSE, "pipe_mass": 0.222 - mass, "fluid_mass": mass})
        there = hose.speed_si(found.curves[0].y[place])
        assert curve.y[place] == pytest.approx(there, rel=1e-9)
        assert columns["u (m/s)"][place] == pytest.approx(there, rel=1e-9)


def test_each_member_of_an_ensemble_has_its_own_units():
    long = pp.Pipe.from_si(**{**HOSE, "length": 0.9})
    models = [pp.Chain(SCALED, 3), pp.Chain(long, 3)]
    found = pp.simulate_many(models, [2.0, 2.0], 1.0, [[0.1, 0.1, 0.1]] * 2, samples=3)
    columns = found.columns("si")
    alone = [one.in_si() for one in found.motions]
    np.testing.assert_allclose(columns["t (s)"], np.concatenate([one.t for one in alone]))
    np.testing.assert_allclose(
        columns["tip_y (m)"], np.concatenate([one.tip[:, 1] for one in alone])
    )


def test_what_is_in_si_already_is_not_converted_again():
    found = pp.identify(SCALED, [pp.Measurement("frequency", 1.0, 0.01)], ["bending_stiffness"])
    assert found.in_si() is found
    assert found.units == {
        "bending_stiffness": "N m^2",
        "critical_speed": "m/s",
        "critical_speed_uncertainty": "m/s",
    }
    assert "unknowns=('bending_stiffness (N m^2)',), values=[" in repr(found)
    assert "critical_speed (m/s)=" in repr(found)
    assert found.columns()["unit"].tolist() == ["N m^2"]
    assert "nondimensional" not in found._repr_html_()
    with pytest.raises(TypeError, match="pipe must be a Pipe, got 3"):
        found.in_si(3)
    bare = pp.identify(pp.Pipe(0.2, 3.0), [pp.Measurement("frequency", 4.0, 0.01)], ["gamma"])
    assert bare.units == {}
    assert "unknowns=('gamma',)" in repr(bare)
    with pytest.raises(ValueError, match=r"numbers in SI need a pipe made with Pipe\.from_si"):
        bare.in_si()
    assert list(found.columns("si")) == list(found.columns())


def test_a_part_of_a_result_needs_the_pipe_or_the_whole():
    part = pp.critical_speed(SCALED_CHAIN).sensitivity
    with pytest.raises(
        ValueError, match=r"Sensitivity does not hold its pipe; .* of the whole's in_si"
    ):
        part.in_si()
    gamma = part.in_si(SCALED).speed.gamma
    assert gamma == SCALED.speed_si(part.speed.gamma)
    start = f"Sensitivity in SI(speed=Derivatives in SI(gamma={gamma:.7g} m/s, "
    assert repr(part.in_si(SCALED)).startswith(start)
    trade = pp.trade(SCALED, "critical_speed", families="beam", sizes=[4], repeats=1)
    law = trade.orders()["beam"]
    with pytest.raises(ValueError, match="ConvergenceLaw has no numbers to convert"):
        law.in_si(SCALED)


def test_methods_are_those_of_the_result_itself():
    si = pp.modes(SCALED_CHAIN, 2.0).in_si()
    with pytest.raises(AttributeError, match='of the Modes itself, with units="si"'):
        si.to_dataframe()
    with pytest.raises(AttributeError, match=r"what in_si\(\) gives has no save: call .* itself$"):
        si.save("modes.npz")
    with pytest.raises(TypeError, match=r'got in_si\(\) of a Modes: pass the Modes itself, .*"si"'):
        pp.plot.root_loci(si)


def test_a_table_tells_its_units_from_those_of_its_caption():
    caption = "These numbers are nondimensional, those of the table in SI units."
    assert caption in pp.modes(SCALED_CHAIN, 2.0)._repr_html_()
    assert caption not in pp.modes(chain(), 2.0)._repr_html_()


def test_redundant_coordinates_have_no_one_unit():
    scene = pp.modular.chain(SCALED, 2)
    motion = pp.simulate(scene, 1.0, 0.1, [0.1, 0.1], samples=3)
    assert "qdot_0" in motion.columns("si")
    exponent = pp.lyapunov_exponent(pp.Chain(SCALED, 2), 4.0, bend, duration=5.0, transient=1.0)
    assert "history (1/s)" in exponent.columns("si", SCALED)
