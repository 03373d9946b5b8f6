"""Large batches go to several threads: each member has what it has alone, whoever asks."""

import multiprocessing
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import pipedyn as pp
from pipedyn import _core
from pipedyn.models.base import ROWS
from pipedyn.orbits.periodic_orbit import STAGE_NODES

PIPE = pp.Pipe(0.2, 10.0, drag=0.5, terms=[pp.PointMass(1.0, 0.2)])
ASPIRATING = pp.Pipe(0.4, 5.0, "aspirating", inflow_share=0.5, terms=[pp.AddedMass(0.3)])
MODELS = {
    "chain": pp.Chain(PIPE, 3),
    "galerkin": pp.Galerkin(PIPE, 3),
    "scene": pp.modular.chain(PIPE, 2),
    "turned jet": pp.Galerkin(pp.Pipe(0.2, 10.0, jet_angle=0.3), 6, "legendre"),
    "added mass": pp.Galerkin(ASPIRATING, 5, "legendre"),
    "pinned": pp.Galerkin(pp.Pipe(0.2, end="pinned"), 4, "legendre"),
    "pinned chain": pp.Chain(pp.Pipe(0.2, end="pinned"), 4),
}
MEMBERS = 3000


def batch(model, members=MEMBERS):
    random = np.random.default_rng(7)
    y = 0.3 * random.normal(size=(2 * model.integrated, members))
    return y, random.uniform(1.0, 8.0, members), random.normal(size=(ROWS, members))


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_members_of_a_large_batch_have_what_they_have_alone(name, driven):
    model = MODELS[name]
    y, u, drive = batch(model)
    drive = drive if driven else None
    whole = model.motion_rates(y, u, drive).T, model.motion_jacobian(y, u, drive)
    for k in (0, 1, MEMBERS // 2 - 1, MEMBERS // 2, MEMBERS - 1):
        one = y[:, k], u[k], None if drive is None else drive[:, k]
        pair = model.motion_rates(*one), model.motion_jacobian(*one)
        for found, alone in zip(whole, pair, strict=True):
            assert np.abs(found[k] - alone).max() <= 1e-9 * np.abs(alone).max()


@pytest.mark.parametrize("members", [1, 5, MEMBERS])
@pytest.mark.parametrize("name", MODELS)
def test_linearised_rates_are_the_rates_and_their_derivatives(name, members):
    model = MODELS[name]
    y, u, drive = batch(model, members)
    found = model.motion_linearised(y, u, drive)
    rates, slopes = model.motion_rates(y, u, drive).T, model.motion_jacobian(y, u, drive)
    ahead, behind = (model.motion_rates(y, u + h, drive).T for h in (0.1, -0.1))  # of degree two
    expected = (rates, (ahead - behind) / 0.2, *slopes.transpose(1, 0, 2))
    assert found.shape == (members, 2 + 2 * model.integrated, 2 * model.integrated)
    for part, right in zip(found.transpose(1, 0, 2), expected, strict=True):
        assert np.abs(part - right).max() <= 1e-8 * max(np.abs(rates).max(), np.abs(right).max())


def test_several_callers_at_once_have_what_one_has():
    model = MODELS["galerkin"]
    y, u, _ = batch(model)
    alone = model.motion_jacobian(y, u)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: model.motion_jacobian(y, u), range(12)):
            assert np.array_equal(found, alone) or found == pytest.approx(alone, rel=1e-9, abs=1e-9)


def _in_child(model, y, u, answers):
    answers.put(model.motion_rates(y, u)[-1])  # few enough for the queue


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own():
    model = MODELS["galerkin"]
    y, u, _ = batch(model)
    alone = model.motion_rates(y, u)
    context = multiprocessing.get_context("fork")
    answers = context.SimpleQueue()
    child = context.Process(target=_in_child, args=(model, y, u, answers), daemon=True)
    child.start()
    child.join(30.0)
    assert child.exitcode == 0
    assert np.array_equal(answers.get(), alone[-1])


@pytest.mark.parametrize("singular", [0, 199])
def test_a_singular_interval_is_refused_whichever_thread_meets_it(singular):
    count, stages, speed = 200, STAGE_NODES.size, 1.0
    model = pp.Chain(pp.Pipe(0.2), 1)
    rest, still = np.zeros((count, 2)), np.zeros((count, stages, 1))
    slope = model.motion_jacobian(rest[0], speed)[1, 1]
    own = STAGE_NODES, np.eye(stages), np.zeros((stages, stages))  # k = ... + slope h k
    h = np.full(count, 0.5 / slope)
    rest_of = None, None, False, True, False, 1e5

    def linearised():
        orbit = h, rest, still, own, 1.0, 1.0, np.array([speed])
        return _core.LinearisedOrbit(model.core, *orbit, *rest_of)

    linearised()
    h[singular] = 1.0 / slope
    assert h[singular] * slope == 1.0
    with pytest.raises(np.linalg.LinAlgError, match="Singular"):
        linearised()
