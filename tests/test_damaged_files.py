# SPDX-License-Identifier: MIT
"""Files that are damaged, or come from elsewhere, are refused in words and take no memory."""

import io
import json
import tracemalloc
import warnings
import zipfile

import numpy as np
import pytest
from damage import BYTES, DAMAGE, at, cases, nodes, outcome, read, written, zipped
from saved_things import differences, facts, path_of

import pipedyn as pp


@pytest.mark.parametrize("damage", DAMAGE, ids=lambda damage: damage.__name__)
def test_damaged_files_load_or_are_refused(damage, tmp_path):
    """Those whose bytes are damaged are refused, or are as good as before."""
    refused = 0
    for name, _, data in cases(50, 1, [damage]):
        with warnings.catch_warnings(record=True) as said:
            found = outcome(data, tmp_path / "damaged.npz")
        assert said == []
        if isinstance(found, Exception):
            assert isinstance(found, ValueError | OSError), repr(found)
            assert isinstance(found, OSError) or "damaged.npz cannot be loaded: " in str(found)
            refused += 1
        elif damage in BYTES:
            assert differences(facts(found), facts(pp.load(path_of(name)))) == []
    assert refused > 10


def edited(name, tmp_path, edit):
    """The path of a thing's file whose header and arrays a function has changed."""
    header, arrays = read(path_of(name).read_bytes())
    edit(header, arrays)
    path = tmp_path / "edited.npz"
    path.write_bytes(written(header, arrays))
    return path


def fields_of(header, kind):
    """Those of the first object of a class."""
    return next(
        one["fields"] for one in header["objects"] if kind in (one.get("class"), one.get("parts"))
    )


LACKING = object()
SERIES, ORBIT = "models.profile._Series.coefficients", "bifurcation.periodic_orbit.PeriodicOrbit"


def changed(where, change):
    """Gives a field of the first object of a class another value, or changes the array in it."""
    kind, _, field = where.rpartition(".")

    def edit(header, arrays):
        fields = fields_of(header, kind)
        if change is LACKING:
            del fields[field]
        elif callable(change):
            member = header["objects"][fields[field]["object"]]["array"]
            arrays[member] = change(arrays[member])
        else:
            fields[field] = change

    return edit


@pytest.mark.parametrize(
    ("name", "where", "change", "said"),
    [
        (
            "chain",
            "Chain._lengths",
            lambda a: np.full(3, 0.9),
            r"sum\(lengths\) must be 1, got 2.7",
        ),
        ("chain", "Chain._joints", lambda k: -k, r"joints must .* >= 0"),
        ("chain", "Chain._joints", lambda k: k[:2], "joints must have 3 or 4 entries"),
        ("chain", "Chain._gyration_radii", lambda a: a * np.nan, "got nan at index 0"),
        ("chain", "Chain._rule", "steep", "rule must be one of 'consistent'"),
        ("chain", "Chain._base", 0.5, r"base \+ sum\(lengths\) must be 1"),
        ("chain", "Chain._approximates", 1, "approximates must be True or False"),
        ("chain", "Chain._reference", {"tuple": [0.1]}, "reference must have 3 entries"),
        ("chain", "Chain._masses", LACKING, "masses of Chain is missing"),
        ("chain", "Chain._rule", LACKING, "'rule' is missing"),
        ("chain", "Chain.lengths", 1, "which `save` does not write"),
        (
            *("chain that is held", "Chain._lengths"),
            *(lambda a: np.add(a, [0.01, 0.0, 0.0, 0.0, -0.01]), "a segment must end"),
        ),
        ("chain that rests bent", "Chain._reference", lambda q: q + np.nan, "got nan at index 0"),
        ("chain of arrays", "Chain._masses", lambda m: 0.01 * m, "at least beta = 0.2 times"),
        ("beam functions", "Galerkin._size", -3, "m must be from 1 to 2000, got -3"),
        ("beam functions", "Galerkin._size", 3.0, "m of Galerkin must be int, got 3.0"),
        ("beam functions", "Galerkin._size", True, "m of Galerkin must be int, got True"),
        ("beam functions", "Galerkin._more", -1, "more must be from 0 to 2000, got -1"),
        ("beam functions", "Galerkin._basis", "sine", "basis of Galerkin must be one of 'beam'"),
        ("legendre functions", "Galerkin._size", 1, "m must be at least 2"),
        (
            *("beam functions that are held", "Galerkin._reference"),
            *({"tuple": [0.1, 0.2, 0.3, 0.4]}, "reference must have 6 entries, got 4"),
        ),
        (
            "continuum",
            "Pipe.jet_angle",
            9.5,
            r"jet_angle must lie in \[-3\.14159, 3\.14159\], got 9\.5",
        ),
        ("pipe", "Pipe.beta", 2.0, r"beta must lie in \[0, 1\), got 2.0"),
        ("pipe", "Pipe.gamma", LACKING, "gamma of Pipe is missing"),
        ("pipe with every term", "Spring.stiffness", -1.0, "stiffness must be finite and >= 0"),
        *(
            ("pipe that varies", SERIES, {"tuple": values}, said)
            for values, said in (
                ([1.0, {"number": "nan"}], r"values must lie in \[1e-06, 1e\+06\], got nan"),
                ([-1.0, 0.5], r"values must lie in \[1e-06, 1e\+06\], got -1.5 to"),
                ([], "a series must have from 1 to 128 coefficients"),
            )
        ),
        ("scene", "modular.Segment.length", 0.9, r"lengths .* must .* 1|add up"),
        ("scene", "modular.Guide.node", 7, "node"),
        ("Motion", "Motion.u", "fast", "u of Motion must be"),
        ("Motion", "Motion.evaluations", 2.5, "evaluations of Motion must be int, got 2.5"),
        ("Motion", "Motion.events", None, "events of Motion must be tuple"),
        ("Motion", "Motion.q", lambda a: a.astype(np.float32), "q of Motion must be"),
        ("Motion", "Motion.q", lambda a: a.astype(int), "q of Motion must be"),
        ("Motion", "Motion.energy", lambda a: a.astype(str), "energy of Motion must be"),
        ("DenseOutput", "DenseOutput.t", lambda a: a[::-1], "t of DenseOutput must ascend"),
        ("CriticalSpeed", "CriticalSpeed.kind", "collapse", "kind of CriticalSpeed must be"),
        ("CriticalSpeed", "CriticalSpeed.model", {"object": 0}, "model of CriticalSpeed must be"),
        ("CriticalSpeed", "CriticalSpeed.speed", 10**400, "speed of CriticalSpeed must be float"),
        ("Failure", "Failure.error", "no", "error of Failure must be Exception"),
        ("LimitCycle", f"{ORBIT}.edges", lambda a: a[::-1], "edges of an orbit must ascend from 0"),
        ("LimitCycle", f"{ORBIT}.rates", lambda a: a[:, :7], "must have shapes that agree"),
        ("LimitCycle", f"{ORBIT}.frequency", 0.0, "a frequency > 0"),
        (
            *("ForcedResponse", "bifurcation.collocation.OrbitProblem.unit"),
            *(0.0, "unit must be finite and > 0"),
        ),
    ],
)
def test_numbers_are_checked_as_by_constructors_and_against_their_types(
    name, where, change, said, tmp_path
):
    with pytest.raises(ValueError, match=rf"edited\.npz cannot be loaded: .*({said})"):
        pp.load(edited(name, tmp_path, changed(where, change)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace('"beta": 0.2', '"beta": 0.3, "beta": 0.2'), "names something"),
        (lambda text: text.replace("0.2,", "NaN,"), "has the number nan, which is not finite"),
        (lambda text: text.replace("0.2,", "1e999,"), "has the number inf, which is not finite"),
        (lambda text: text[:-1], "is no JSON: Expecting"),
        (lambda text: [text], "is no text"),
        (lambda text: 7, "is no text"),
    ],
)
def test_a_header_is_a_text_in_json_that_names_each_thing_once(change, said, tmp_path):
    header, _ = read(path_of("pipe").read_bytes())
    text = json.dumps(header)
    np.savez(tmp_path / "pipe.npz", header=np.array(change(text)))
    with pytest.raises(ValueError, match=rf"pipe\.npz cannot be loaded: its header {said}"):
        pp.load(tmp_path / "pipe.npz")


@pytest.mark.parametrize("name", ["header.npy", "array0.npy"])
def test_a_member_that_is_there_twice_is_refused(name, tmp_path):
    """Whatever its two parts hold: readers differ in which of them they take."""
    with zipfile.ZipFile(path_of("chain")) as file:
        members = [(one, file.read(one)) for one in file.namelist()]
    path = tmp_path / "twice.npz"
    path.write_bytes(zipped([*members, (name, dict(members)[name])]))
    with pytest.raises(ValueError, match="cannot be loaded: two of its members have one name"):
        pp.load(path)


def test_arguments_of_exceptions_are_checked(tmp_path):
    def edit(header, arrays):
        error = next(one for one in header["objects"] if "error" in one)
        error["args"] = {"tuple": ["it stopped", 3]}

    with pytest.raises(ValueError, match="motion of MotionStopped must be Motion, got 3"):
        pp.load(edited("MemberFailure", tmp_path, edit))


@pytest.mark.parametrize("version", [1.0, True, "1", None, 0, -1, [1]])
def test_a_format_is_a_whole_number(version, tmp_path):
    with pytest.raises(ValueError, match="its format must be a whole number >= 1, got"):
        pp.load(edited("pipe", tmp_path, lambda header, arrays: header.update(format=version)))


@pytest.mark.parametrize(
    "root", [5, None, "text", {"tuple": []}, {"object": 1}], ids=lambda root: str(root)
)
def test_what_is_no_result_model_or_pipe_is_refused(root, tmp_path):
    def edit(header, arrays):
        header["root"] = root
        header["objects"].append({"error": "ValueError", "args": {"tuple": ["no"]}})

    with pytest.raises(ValueError, match="it has no result, model or pipe, but"):
        pp.load(edited("pipe", tmp_path, edit))


# ------------------------------------------------------------------------- what takes no memory


def peak_of_refusal(data, tmp_path, said):
    """Bytes of memory that a file takes until it is refused."""
    path = tmp_path / "large.npz"
    path.write_bytes(data)
    pp.Pipe(0.2).save(tmp_path / "small.npz")
    pp.load(tmp_path / "small.npz")  # which imports and keeps what every loading does
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=rf"large\.npz cannot be loaded: .*{said}"):
            pp.load(path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_an_array_that_is_named_many_times_is_read_once(tmp_path):
    """So a file of 6 kB took 4 GB."""
    header, _ = read(path_of("pipe").read_bytes())
    header["objects"] += [{"array": "array0"}] * 20_000
    data = written(header, {"array0": np.zeros(25_000)})
    assert len(data) < 10_000
    assert peak_of_refusal(data, tmp_path, "no array 'array0', or more than once") < 10e6


def test_objects_that_share_a_large_array_read_it_so_many_times_and_no_more(tmp_path):
    """Each goes through its arrays, though a thousand of them take no more of a file."""
    header, _ = read(path_of("pipe").read_bytes())
    (pipe,) = header["objects"]
    header["objects"] = [{"array": "array0"}, pipe]
    data = {}
    for times in (999, 1001):
        pipe["fields"]["terms"] = {"tuple": [{"object": 0}] * times}
        data[times] = written(header, {"array0": np.zeros(1_000_000)})
    assert peak_of_refusal(data[1001], tmp_path, "made of more than 1000000000 numbers") < 20e6
    peak_of_refusal(data[999], tmp_path, "terms must be at most 400, got 999")


def test_members_that_share_their_bytes_are_refused(tmp_path):
    """The directory of an archive says 2,000 times where the same 200 kB are."""
    plain = zipped([("header.npy", b""), ("array0.npy", bytes(200_000))])
    end = plain.rindex(b"PK\x05\x06")
    start = int.from_bytes(plain[end + 16 : end + 20], "little")
    entry = plain[plain.rindex(b"PK\x01\x02") : end]
    count = 2_000
    entries = b"".join(
        entry.replace(b"array0.npy", f"a{number:05}.npy".encode()) for number in range(count)
    )
    numbers = count.to_bytes(2, "little") * 2 + len(entries).to_bytes(4, "little")
    data = plain[:start] + entries + plain[end : end + 8] + numbers + plain[end + 16 :]
    assert zipfile.ZipFile(io.BytesIO(data)).namelist()[-1] == f"a{count - 1:05}.npy"
    assert peak_of_refusal(data, tmp_path, "its members are longer than the file") < 50e6


def described(shape, dtype="<f8", data=b""):
    """A member that says it is such an array."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


@pytest.mark.parametrize(
    ("shape", "dtype", "said"),
    [
        ("(1000000000000,)", "<f8", "array0 has more than 1000000000 entries"),
        ("(9223372036854775807, 2, 3)", "<f8", "array0 has more than 1000000000 entries"),
        ("(900000000,)", "<c16", "array0 is not as long as its shape says"),
        ("(4294967296, 4294967296, 0, 7)", "<f8", "is not as long as its shape says"),
        ("(-1,)", "<f8", "array0 is described otherwise than `save` does"),
        ("(1,)", "|O", "array0 is described otherwise than `save` does"),
        ("(1,)", "<U99999999999", "not a valid dtype|array0 is not as long"),
    ],
)
def test_shapes_are_judged_before_memory_is_taken(shape, dtype, said, tmp_path):
    header, _ = read(path_of("pipe").read_bytes())
    header["objects"].append({"array": "array0"})
    members = [("array0.npy", described(shape, dtype, b"\2" * 64))]
    with zipfile.ZipFile(io.BytesIO(written(header, {}))) as good:
        members.append(("header.npy", good.read("header.npy")))
    assert peak_of_refusal(zipped(members), tmp_path, said) < 2e6


def test_what_a_member_says_of_its_size_is_judged_before_memory_is_taken(tmp_path):
    """Neither the member nor the directory has a size that its bytes can have."""
    header, _ = read(path_of("pipe").read_bytes())
    header["objects"].append({"array": "array0"})
    with zipfile.ZipFile(io.BytesIO(written(header, {}))) as file:
        text = file.read("header.npy")
    huge = described("(100000000,)", data=bytes(800))
    data = bytearray(zipped([("array0.npy", huge), ("header.npy", text)]))
    said = len(huge).to_bytes(4, "little")
    assert data.count(said) == 2
    data = data.replace(said, (len(huge) - 800 + 800_000_000).to_bytes(4, "little"))
    refusal = "array0 is longer than what it is compressed to can be"
    assert peak_of_refusal(bytes(data), tmp_path, refusal) < 2e6


def test_a_header_that_is_too_long_is_not_read(tmp_path):
    """Of 16 million characters that take 60 kB."""
    data = written("[" + "0," * 8_000_000 + "0]", {})
    assert len(data) < 100_000
    assert peak_of_refusal(data, tmp_path, "its header is longer than") < 2e6


@pytest.mark.parametrize("deep", ["[" * 100_000, '{"tuple": [' * 900 + "]}" * 900])
def test_what_is_nested_too_deeply_is_refused(deep, tmp_path):
    header, _ = read(path_of("pipe").read_bytes())
    text = json.dumps(header | {"root": 1}).replace('"root": 1', f'"root": {deep}')
    path = tmp_path / "deep.npz"
    path.write_bytes(written(text, {}))
    with pytest.raises(ValueError, match=r"deep\.npz cannot be loaded: "):
        pp.load(path)


def test_what_is_nested_too_deeply_is_not_saved(tmp_path):
    inner = ()
    for _ in range(2000):
        inner = (inner,)
    with pytest.raises(ValueError, match="Failure cannot be saved: it is nested too deeply"):
        pp.Failure(0, 1.0, ValueError(inner)).save(tmp_path / "deep.npz")
    assert list(tmp_path.iterdir()) == []


def test_every_value_of_a_header_may_be_missing_or_of_another_type(tmp_path):
    """Of a small one: each of its nodes in turn."""
    header, arrays = read(path_of("chain of arrays").read_bytes())
    text = json.dumps(header)
    for path in nodes(header):
        for value in (None, [], "x"):
            changed = json.loads(text)
            if not path:
                changed = value
            else:
                at(changed, path[:-1])[path[-1]] = value
            found = outcome(written(changed, arrays), tmp_path / "changed.npz")
            assert not isinstance(found, Exception) or isinstance(found, ValueError | OSError)
