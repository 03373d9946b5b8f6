# SPDX-License-Identifier: MIT
"""What is saved is loaded again, equal and as useful as it was; what cannot be is refused."""

import json
import math

import numpy as np
import pytest

import pipedyn as pp

HOSE = pp.Pipe.from_si(
    length=0.45,
    bending_stiffness=7.3e-3,
    pipe_mass=0.19,
    fluid_mass=0.032,
    terms=[pp.PointMass(0.45, 0.01)],
)
TAPERED = pp.Pipe(0.2, stiffness=lambda s: 1.0 - 0.5 * s, mass=pp.Profile([0.5], [1.0, 0.7]))


def again(thing, tmp_path):
    path = tmp_path / "saved.npz"
    thing.save(path)
    assert [one.name for one in tmp_path.iterdir()] == ["saved.npz"]
    return pp.load(path)


def test_pipes_keep_their_units(tmp_path):
    loaded = again(HOSE, tmp_path)
    assert loaded == HOSE
    assert loaded.scales == HOSE.scales
    assert loaded.speed_si(1.0) == HOSE.speed_si(1.0)
    assert again(TAPERED, tmp_path) == TAPERED


def test_a_file_of_another_kind_than_asked_for_is_refused(tmp_path):
    pp.Chain(pp.Pipe(0.2), 2).save(path := tmp_path / "chain.npz")
    assert isinstance(pp.load(path, pp.Model), pp.Chain)
    with pytest.raises(TypeError, match=r"chain\.npz holds a Chain, not a Pipe$"):
        pp.load(path, pp.Pipe)
    with pytest.raises(TypeError, match="kind must be a class, got 'Chain'"):
        pp.load(path, "Chain")


def test_numbers_are_kept_to_the_bit(tmp_path):
    odd = pp.Failure(3, math.nan, ValueError("no", 1e-300, -0.0, math.inf, 1 + 2j))
    loaded = again(odd, tmp_path)
    assert math.isnan(loaded.value)
    assert loaded.error.args == odd.error.args
    assert math.copysign(1.0, loaded.error.args[2]) == -1.0


def test_a_loaded_branch_can_be_asked_further(tmp_path):
    model, base = pp.Galerkin(pp.Pipe(0.2, damping=0.01), 3), pp.Harmonic(0.01, 13.0, "x")
    found = pp.forced_response(model, 5.0, base=base, frequencies=(12.5, 13.5))
    (mine,), (its,) = found.at(13.0), again(found, tmp_path).at(13.0)
    assert its.amplitude == mine.amplitude
    cycle = again(pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 2), 4.0), tmp_path)
    assert pp.limit_cycle(cycle.model, 4.1, cycle).amplitude > cycle.amplitude


def test_functions_of_the_users_are_refused_by_their_place(tmp_path):
    wall = pp.modular.Custom(nodes=(2,), energy=lambda q: q[0] ** 4, name="wall")
    scene = pp.modular.chain(pp.Pipe(0.2), 2).plus(wall)
    with pytest.raises(
        ValueError, match=r"Assembly.modules\[\d+\].energy cannot be saved: it is a "
    ):
        scene.save(tmp_path / "scene.npz")
    motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 3), lambda t: 3.0 + 0.0 * t, 0.5, lambda s: 0.1 * s)
    with pytest.raises(
        ValueError, match=r"Motion\.u cannot be saved: it is a Python function; to_csv"
    ):
        motion.save(tmp_path / "motion.npz")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("thing", "path", "kind", "message"),
    [
        (pp.Pipe(0.2), "x.json", ValueError, r"path must end in .npz, got 'x.json'"),
        (pp.Pipe(0.2), 3, TypeError, "path must be a path, got 3"),
        (pp.Pipe(0.2), "none/x.npz", ValueError, "path must lie in a folder that exists"),
    ],
)
def test_bad_arguments_are_named(thing, path, kind, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(kind, match=message):
        thing.save(path)


def header_of(path):
    with np.load(path) as file:
        return json.loads(str(file["header"]))


def test_files_say_who_wrote_them_and_later_ones_are_refused(tmp_path):
    path = tmp_path / "pipe.npz"
    pp.Pipe(0.2).save(path)
    header = header_of(path)
    assert (header["format"], header["package"]) == (1, pp.__version__)
    header["format"], header["package"] = 2, "9.9"
    np.savez(path, header=np.array(json.dumps(header)))
    with pytest.raises(ValueError, match=r"cannot be loaded: it was written by pipedyn 9.9"):
        pp.load(path)


@pytest.mark.parametrize(
    "changed",
    [
        {"objects": [{"class": "os.system", "fields": {}}]},
        {"objects": [{"error": "print", "args": {"tuple": ["x"]}}]},
        {"objects": [], "root": {"object": 5}},
        {"objects": [{"array": "missing"}]},
    ],
)
def test_files_that_were_changed_are_refused(changed, tmp_path):
    path = tmp_path / "pipe.npz"
    pp.Pipe(0.2).save(path)
    np.savez(path, header=np.array(json.dumps(header_of(path) | changed)))
    with pytest.raises(ValueError, match=r"pipe\.npz cannot be loaded"):
        pp.load(path)


@pytest.mark.parametrize(
    ("header", "lacking"), [("{}", "format"), ("[]", "format"), ('{"format": 1}', "package")]
)
def test_what_a_header_lacks_is_told(header, lacking, tmp_path):
    path = tmp_path / "other.npz"
    np.savez(path, header=np.array(header))
    with pytest.raises(ValueError, match=f"cannot be loaded: its header has no '{lacking}', which"):
        pp.load(path)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "other.npz"
    path.write_text("no archive")
    with pytest.raises(ValueError, match="cannot be loaded"):
        pp.load(path)
    np.savez(path, header=np.array([object()], dtype=object))
    with pytest.raises(ValueError, match="cannot be loaded"):
        pp.load(path)
    with pytest.raises(FileNotFoundError):
        pp.load(tmp_path / "none.npz")
