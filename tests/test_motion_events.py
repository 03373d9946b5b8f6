# SPDX-License-Identifier: MIT
"""What is asked of a motion besides samples: events, all states, other times, a speed that varies.

Independent routes: elliptic integrals of the pendulum, and scipy's `solve_ivp` on `model.rhs`.
"""

import math
import os
import pickle
import sys
import threading

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import pipedyn as pp

CHAIN = pp.Chain(pp.Pipe(0.2), 5)
SCENE = pp.modular.chain(pp.Pipe(0.2), n=3)
OWN = SCENE.plus(pp.modular.Custom(nodes=(1,), energy=lambda q: 0.0 * q[0]))
CORE = "dop853", "radau"
SHARP = {"rtol": 1e-11, "atol": 1e-13}


def bow(s):
    return 0.1 * s


def tip_angle(t, q, qdot):
    return q[-1]


def by_scipy(u, end, t0=0.0, rate=lambda t: 0.0, **options):
    """The motion of CHAIN from the bow, by scipy on the model's right-hand side."""
    start = np.concatenate([CHAIN.bent(bow), np.zeros(5)])
    speed = u if callable(u) else lambda t: u
    return solve_ivp(
        *(lambda t, y: CHAIN.rhs(t, y, speed(t), u_dot=rate(t)), (t0, end), start),
        **({"method": "DOP853"} | SHARP | options),
    )


# ----------------------------------------------------------------------------------------- events


@pytest.mark.parametrize("method", CORE)
def test_a_pendulum_hangs_straight_at_odd_quarters_of_its_period(method):
    gamma, angle = 7.0, 2.0
    chain = pp.Chain(pp.Pipe(0.0, gamma=gamma), springs=[0.0])
    period = 4.0 / np.sqrt(1.5 * gamma) * ellipk(np.sin(0.5 * angle) ** 2)
    events = [pp.Event(tip_angle, direction=direction) for direction in (0, -1, 1)] + [
        lambda t, q, qdot: qdot[0]
    ]
    motion = pp.simulate(
        *(chain, 0.0, 2.1 * period, [angle]), events=events, samples=3, method=method, **SHARP
    )
    quarters = 0.25 * period * np.array([1.0, 3.0, 5.0, 7.0])
    both, falling, rising, turning = motion.events
    assert both.t == pytest.approx(quarters, abs=1e-9)
    assert falling.t == pytest.approx(quarters[::2], abs=1e-9)
    assert rising.t == pytest.approx(quarters[1::2], abs=1e-9)
    assert both.q.shape == both.qdot.shape == (4, 1)
    assert np.abs(both.q).max() < 1e-14  # of the interpolant: to rounding
    assert (np.sign(falling.qdot) == -1.0).all()
    # It starts where q' = 0, which is no event: it was not on the other side before.
    assert turning.t == pytest.approx(0.5 * period * np.arange(1.0, 5.0), abs=1e-8)
    assert turning.q[:, 0] == pytest.approx(angle * np.array([-1, 1, -1, 1]), abs=1e-8)


@pytest.fixture(scope="module")
def theirs():
    """The motion of CHAIN at u = 4 with its tip's events, by scipy."""

    def event(t, y):
        return y[4]

    event.direction = -1
    return by_scipy(4.0, 5.0, events=event, dense_output=True)


@pytest.mark.parametrize("method", CORE)
def test_events_and_the_states_there_are_those_of_solve_ivp(method, theirs):
    ours = pp.simulate(CHAIN, 4.0, 5.0, bow, events=pp.Event(tip_angle, -1), method=method, **SHARP)
    [found] = ours.events
    assert found.t.size > 5
    assert found.t == pytest.approx(theirs.t_events[0], abs=1e-7)
    states = np.concatenate([found.q, found.qdot], axis=1)
    assert states == pytest.approx(theirs.y_events[0], abs=1e-5)
    assert ours.t[-1] == 5.0


@pytest.mark.parametrize("method", CORE)
@pytest.mark.parametrize("count", [True, 3])
def test_a_terminal_event_ends_the_motion_and_what_was_asked_of_it(method, count):
    def event(t, q, qdot):
        return q[-1]

    event.direction, event.terminal = -1, count  # as solve_ivp takes them
    whole = pp.simulate(CHAIN, 4.0, 5.0, bow, events=pp.Event(tip_angle, -1), method=method)
    ended = pp.simulate(
        *(CHAIN, 4.0, 5.0, bow),
        events=[event, lambda t, q, qdot: qdot[0]],
        dense=True,
        method=method,
    )
    first, other = ended.events
    assert first.t == pytest.approx(whole.events[0].t[: int(count)], abs=1e-12)
    at = first.t[-1]
    assert ended.t[-1] <= at < ended.t[-1] + 0.01 + 1e-12  # 501 samples
    assert (ended.t == whole.t[: ended.t.size]).all()
    assert other.t.size > 1
    assert other.t[-1] <= at
    np.testing.assert_allclose(ended.dense(at)[:5], first.q[-1], atol=1e-13)
    assert ended.dense.t[-1] == at
    between = np.linspace(ended.dense.t[-2], at, 9)
    np.testing.assert_allclose(
        ended.dense(between), longer(method).dense(between), rtol=1e-12, atol=1e-12
    )
    with pytest.raises(ValueError, match="t must lie"):
        ended.dense(at + 1e-9)
    assert ended.audit < 1e-6


def longer(method):
    return pp.simulate(CHAIN, 4.0, 5.0, bow, dense=True, method=method)


@pytest.mark.parametrize("method", CORE)
@pytest.mark.parametrize(
    "shape",
    [lambda x: x**9, lambda x: 1e-200 * x, np.sign, lambda x: np.expm1(50.0 * x)],
    ids=["flat", "tiny", "jump", "steep"],
)
def test_when_an_event_takes_place_depends_on_its_sign_alone(method, shape):
    events = [tip_angle, lambda t, q, qdot: shape(q[-1])]
    plain, shaped = pp.simulate(CHAIN, 4.0, 5.0, bow, events=events, method=method).events
    # The ninth power is the smallest of numbers, 0, over a short while.
    assert shaped.t == pytest.approx(plain.t, abs=1e-12)


@pytest.mark.parametrize("method", CORE)
def test_an_event_that_ends_a_motion_is_not_asked_beyond_its_part_of_a_step(method):
    asked = []

    def event(t, q, qdot):
        asked.append(t)
        return t - 1.0

    pp.simulate(CHAIN, 4.0, 5.0, bow, events=pp.Event(event, terminal=True), method=method)
    assert 1.0 < max(asked) < 1.2


@pytest.mark.parametrize("method", CORE)
def test_an_event_where_two_steps_meet_is_found_there_on_either_side_of_rounding(method):
    steps = pp.simulate(CHAIN, 4.0, 0.5, bow, dense=True, method=method).dense
    states = steps(steps.t[1:-1])
    crossing = np.abs(states[9]) > 0.1  # elsewhere the angle only touches its value
    joints, angles = steps.t[1:-1][crossing], states[4, crossing]
    assert joints.size > 10
    events = [lambda t, q, v, at=at: t - at for at in joints]
    for off in np.arange(-2, 3) * np.finfo(float).eps:  # the steps' ends differ by so much
        events += [lambda t, q, v, at=at: q[-1] - at for at in angles * (1.0 + off)]
    found = pp.simulate(CHAIN, 4.0, 0.5, bow, events=events, method=method).events
    for one, at in zip(found, [*joints] * 6, strict=True):
        assert np.sum(np.abs(one.t - at) < 1e-9) == 1


def test_two_crossings_within_one_step_are_found():
    at_rest = pp.Chain(pp.Pipe(0.2, damping=0.01), 1)
    ends = pp.simulate(at_rest, 1.0, 20.0, bow, dense=True, method="dop853").dense.t
    step = int(np.argmax(np.diff(ends)))
    low, high = ends[step : step + 2]
    a, b = low + 0.3 * (high - low), low + 0.7 * (high - low)
    motion = pp.simulate(
        *(at_rest, 1.0, 20.0, bow), events=lambda t, q, qdot: (t - a) * (t - b), method="dop853"
    )
    assert motion.events[0].t == pytest.approx([a, b], abs=1e-12)


def test_events_go_on_beyond_the_last_sample():
    motion = pp.simulate(CHAIN, 4.0, 5.0, bow, times=[0.5], events=tip_angle)
    whole = pp.simulate(CHAIN, 4.0, 5.0, bow, events=tip_angle)
    assert motion.t.tolist() == [0.5]
    assert motion.events[0].t == pytest.approx(whole.events[0].t, abs=1e-12)


def test_a_scene_s_events_take_its_own_coordinates():
    pipe = pp.Pipe(0.2)
    scene, chain = pp.modular.chain(pipe, n=3), pp.Chain(pipe, 3)
    across = pp.simulate(
        *(scene, 4.0, 2.0, bow), events=lambda t, q, qdot: q[6], dense=True, rtol=1e-9
    )
    assert across.events[0].q.shape[1] == 9
    angles = pp.simulate(
        *(chain, 4.0, 2.0, bow), events=lambda t, q, qdot: np.sin(q).sum(), rtol=1e-9
    )
    assert across.events[0].t == pytest.approx(angles.events[0].t, abs=1e-7)
    assert across.dense(1.0).shape == (18,)


# ----------------------------------------------------------------------------------- dense output


@pytest.mark.parametrize("method", CORE)
def test_states_at_any_time_are_those_of_solve_ivp(method, theirs):
    motion = pp.simulate(CHAIN, 4.0, 3.0, bow, dense=True, samples=7, method=method, **SHARP)
    times = np.linspace(0.0, 3.0, 1001)
    assert motion.dense(times).shape == (10, 1001)
    assert np.abs(motion.dense(times) - theirs.sol(times)).max() < 1e-6
    assert np.abs(motion.dense(motion.t) - motion.y).max() < 1e-12
    assert motion.dense(1.0).shape == (10,)
    assert motion.dense(1) == pytest.approx(motion.dense([1.0])[:, 0], abs=0.0)
    again = pickle.loads(pickle.dumps(motion))
    assert again == motion
    assert (again.dense(0.3) == motion.dense(0.3)).all()
    for outside in (-1e-3, 3.001, np.nan):
        with pytest.raises(ValueError, match="t must lie in"):
            motion.dense(outside)
    assert pp.simulate(CHAIN, 4.0, 3.0, bow).dense is None


@pytest.mark.parametrize("asked", [{"dense": True}, {"events": tip_angle}])
def test_what_is_kept_ends_a_motion_before_it_fills_the_memory(monkeypatch, asked):
    monkeypatch.setattr("pipedyn.motion.integrator.LARGEST_KEPT", 500)
    with pytest.raises(pp.MotionStopped, match="dense output and events") as caught:
        pp.simulate(CHAIN, 6.5, 1e6, bow, times=np.arange(1e3) / 1e4, method="dop853", **asked)
    assert caught.value.motion.t.size >= 1


# -------------------------------------------------------------------- times, speeds and callbacks


@pytest.mark.parametrize("method", [*CORE, "scipy:Radau", "scipy:LSODA"])
def test_a_motion_that_starts_later_is_the_same_motion(method):
    options = {"samples": 11, "rtol": 1e-9 if method in CORE else 1e-8, "method": method}
    early = pp.simulate(CHAIN, 4.0, 0.2, bow, **options)
    late = pp.simulate(CHAIN, 4.0, 0.2, bow, t0=-7.0, **options)
    assert late.t == pytest.approx(early.t - 7.0, abs=1e-14)
    assert np.abs(late.q - early.q).max() < 1e-6
    again = pp.simulate(CHAIN, 4.0, 0.2, bow, t0=-7.0, times=[-6.9, -6.8], rtol=1e-9)
    assert np.abs(again.q - late.q[[5, 10]]).max() < 1e-6


@pytest.mark.parametrize("method", CORE)
@pytest.mark.parametrize("t0", [-1e9, 1e9])
def test_short_steps_at_a_large_time_add_up_to_the_time_passed(method, t0):
    chain = pp.Chain(pp.Pipe(0.2), 20)
    options = {"samples": 2, "rtol": 1e-8, "method": method}
    early = pp.simulate(chain, 4.0, 1.0, bow, **options)
    late = pp.simulate(chain, 4.0, 1.0, bow, t0=t0, **options)
    assert np.abs(late.q - early.q).max() < 1e-9  # times are rounded to 1e-7


@pytest.mark.parametrize("method", [*CORE, "scipy:Radau", "scipy:LSODA"])
def test_a_speed_that_varies_acts_as_in_solve_ivp(method):
    def ramp(t):
        return 2.0 + 3.0 * np.sin(t) ** 2

    def rate(t):
        return 3.0 * np.sin(2.0 * t)

    theirs = by_scipy(ramp, 1.2, t0=1.0, rate=rate, t_eval=np.linspace(1.0, 1.2, 7))
    rtol = 1e-8 if method in CORE else 1e-6
    ours = pp.simulate(CHAIN, ramp, 0.2, bow, t0=1.0, samples=7, method=method, rtol=rtol)
    assert np.abs(ours.y - theirs.y).max() < 1e-3
    assert ours.audit < 1e-5
    assert ours.u is ramp
    assert ours.u(1.0) == ramp(1.0)
    constant = pp.simulate(CHAIN, lambda t: 4, 0.2, bow, samples=3, method=method)
    same = pp.simulate(CHAIN, 4.0, 0.2, bow, samples=3, method=method)
    assert np.abs(constant.q - same.q).max() < 1e-12


def test_an_own_module_feels_a_speed_that_varies():
    def ramp(t):
        return 2.0 + t

    assert OWN.calls_python
    a, b = (pp.simulate(m, ramp, 1.0, bow, samples=5, rtol=1e-9) for m in (SCENE, OWN))
    assert np.abs(a.q - b.q).max() < 1e-9


@pytest.mark.parametrize("method", [*CORE, "scipy:Radau", "scipy:DOP853"])
def test_no_step_is_longer_than_the_longest(method):
    slow = pp.Chain(pp.Pipe(0.2), 1)
    free = pp.simulate(slow, 1.0, 10.0, bow, samples=2, method=method)
    short = pp.simulate(slow, 1.0, 10.0, bow, samples=2, method=method, max_step=0.01)
    assert short.evaluations > 2000 > 1.5 * free.evaluations
    if method in CORE:
        kept = pp.simulate(slow, 1.0, 10.0, bow, method=method, max_step=0.01, dense=True)
        assert np.diff(kept.dense.t).max() == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize("method", [*CORE, "scipy:Radau", "scipy:LSODA"])
def test_a_callback_sees_the_motion_and_ends_it(method):
    seen = []

    def callback(t, q, qdot):
        seen.append((t, q, qdot))
        return True

    motion = pp.simulate(
        *(CHAIN, 4.0, 1e4, bow),
        times=np.linspace(0.0, 1e4, 100_001),
        callback=callback,
        method=method,
    )
    [(t, q, qdot)] = seen
    assert t < 1e4
    assert q.shape == qdot.shape == (5,)
    assert motion.t[-1] <= t < motion.t[-1] + 0.1 + 1e-9
    assert pp.simulate(CHAIN, 4.0, 1.0, bow, callback=lambda *_: None).t[-1] == 1.0


# ------------------------------------------------------------------- interruptions and ensembles


@pytest.mark.parametrize("method", CORE)
@pytest.mark.parametrize("events", [(), tip_angle])
def test_a_motion_is_interrupted_as_python_is(method, events, interrupted_after):
    interrupted_after(
        0.1,
        lambda: pp.simulate(
            *(CHAIN, 6.5, 1e9, bow), times=[1e9], events=events, method=method, most=1e12
        ),
    )


def test_an_ensemble_is_interrupted_with_all_its_threads(interrupted_after):
    threads = threading.active_count()
    interrupted_after(
        0.2,
        lambda: pp.simulate_many(
            *(CHAIN, np.linspace(6.0, 7.0, 200), 1e9, bow), times=[1e9], method="dop853", most=1e12
        ),
    )
    assert threading.active_count() == threads


def test_members_do_not_depend_on_the_number_of_threads(monkeypatch):
    speeds, found = np.linspace(3.0, 6.0, 70), []
    for cores in (1, 2, 5):
        monkeypatch.setattr(os, "cpu_count", lambda cores=cores: cores)
        found.append(pp.simulate_many(CHAIN, speeds, 1.0, bow, samples=5))
    for one, other, last in zip(*(ensemble.motions for ensemble in found), strict=True):
        assert one == other
        assert one == last


def test_another_thread_runs_while_a_motion_goes_on():
    """Python would change threads on its own only after a minute."""
    seen = threading.Event()
    worker = threading.Thread(
        target=pp.simulate,
        args=(CHAIN, 6.5, 1e9, bow),
        kwargs={
            "times": [1e9],
            "method": "dop853",
            "most": 1e12,
            "callback": lambda *_: seen.is_set(),
        },
    )
    interval = sys.getswitchinterval()
    sys.setswitchinterval(60.0)
    try:
        worker.start()
        seen.set()
        worker.join(timeout=30.0)
        assert not worker.is_alive()
    finally:
        sys.setswitchinterval(interval)


# -------------------------------------------------------------------------------------- bad input

CALLED = r"events\[{0}\] must be called as events\[{0}\]\(t, q, qdot\), got a function of \({1}\)"


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"events": 3}, TypeError, r"events\[0\] must be an Event or a function"),
        ({"events": [tip_angle, None]}, TypeError, r"events\[1\] must be an Event"),
        ({"events": lambda t, y: y[0]}, TypeError, CALLED.format(0, r"t, y")),
        ({"events": [tip_angle, pp.Event(lambda t: t)]}, TypeError, CALLED.format(1, "t")),
        ({"events": pp.Event("g")}, TypeError, r"events\[0\].function must be a function"),
        ({"events": pp.Event(tip_angle, "up")}, TypeError, r"events\[0\].direction must be a real"),
        ({"events": pp.Event(tip_angle, 0, -1)}, ValueError, r"events\[0\].terminal must be at l"),
        ({"events": pp.Event(tip_angle, 0, 0.5)}, TypeError, r"events\[0\].terminal must be a wh"),
        ({"events": lambda t, q, qdot: q}, TypeError, r"events\[0\]\(t, q, qdot\) must be a real"),
        ({"events": lambda t, q, qdot: np.nan}, ValueError, r"events\[0\]\(t, q, qdot\) must be f"),
        ({"events": tip_angle, "method": "scipy:Radau"}, ValueError, "events must come with a met"),
        ({"dense": True, "method": "scipy:LSODA"}, ValueError, "dense must come with a method of"),
        ({"t0": 1e9, "duration": 1e-9}, ValueError, "duration must be felt at t0"),
        ({"t0": 1.0, "times": [0.5]}, ValueError, r"times must lie in \[1, 2\]"),
        ({"max_step": 1e-12}, ValueError, "max_step must be at least 1e-09, 1e-9 of the duration"),
        ({"samples": 5, "times": [0.5]}, ValueError, "samples or times must be given, .* not both"),
        ({"q0": lambda s: 0.1}, ValueError, r"q0 must make angles, .* the number 0\.1$"),
        (
            {"q0": pp.Event(tip_angle)},
            TypeError,
            r"q0 must be an angle theta\(s\) or co.*, got Event",
        ),
        ({"u": lambda t: np.nan if t > 0.5 else 1.0}, ValueError, r"u\(0.5\d+\) must be finite"),
    ],
)
def test_a_bad_argument_is_refused_by_name(options, kind, message):
    arguments = {"model": CHAIN, "u": 4.0, "duration": 1.0, "q0": bow} | options
    with pytest.raises(kind, match=message):
        pp.simulate(**arguments)


@pytest.mark.parametrize("model", [CHAIN, OWN], ids=["chain", "own module"])
@pytest.mark.parametrize("method", CORE)
@pytest.mark.parametrize(
    ("later", "kind"), [(-1.0, pp.MotionStopped), (math.nan, ValueError), (None, TypeError)]
)
def test_a_speed_between_the_times_at_which_it_was_tried_is_refused_too(model, method, later, kind):
    """Near these its derivative is tried as well; else what moved before is kept."""
    tried = np.linspace(0.0, 1.0, 101)

    def speed(t):
        return 4.0 if t < 0.5 or t in tried else later

    with pytest.raises(kind, match=r"u\(0\.5\d*\) must (be|lie in)"):
        pp.simulate(model, speed, 1.0, bow, method=method)


def test_what_an_event_a_speed_or_a_callback_raises_is_not_lost():
    def broken(*_):
        raise KeyError("mine")

    def late(t):
        if 0.501 < t < 0.509:
            raise KeyError("mine")
        return 4.0

    given = {"model": CHAIN, "u": 4.0, "duration": 1.0, "q0": bow}
    for options in ({"events": broken}, {"callback": broken}):
        with pytest.raises(KeyError, match="mine"):
            pp.simulate(**given | options)
    with pytest.raises(ValueError, match=r"^u\(0.50\d+\) .* it raised KeyError: 'mine'$"):
        pp.simulate(**given | {"u": late})
