# SPDX-License-Identifier: MIT
"""Golden numbers: what the package answered at commit 3ddf395, before it was rebuilt, to the bit.

    python tests/golden.py                 compares with golden.json; exit code 1 if anything moved
    python tests/golden.py --bits          the same; every number must agree to the bit
    python tests/golden.py --group hopf    these groups only
    python tests/golden.py --write         writes golden.json: done once, at commit 3ddf395

pytest does not collect it. An entry has a name in a group, numbers, and where the result states its
own error that ("tolerance", absolute, else null; of motions rtol). Of a large array it keeps some
numbers and a projection on a fixed random vector. A difference is given relative to the largest
number of its entry; one beyond LARGEST has moved, unless it is within the tolerance.

Right-hand sides, Jacobians, energies and powers are kept at every vector level, those that the
processor lacks left out with a note; all else at "baseline", which every x86-64 processor has, with
one thread of linear algebra. Bits are those of one processor, numpy and scipy (see the file).
`choose` measures times. Its clock here advances by a microsecond, about, when it is read, as for
each right-hand side and factorisation: its choice is always the same, if not that by a watch.
Where two sizes tie rounding decides; the questions here avoid that.
What the rebuild renames stands in `with_fittings`, `parts`, `made` and `setting`.
"""

import argparse
import json
import math
import os
import random
import time
from dataclasses import replace
from itertools import count
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
time.thread_time = map((2.0**-20).__mul__, count()).__next__  # before the package takes it

import numpy as np  # noqa: E402
import scipy  # noqa: E402

import pipedyn as pp  # noqa: E402
from pipedyn import _core  # noqa: E402

COMMIT, FILE = "3ddf395", Path(__file__).with_name("golden.json")
LARGEST = 1e-13  # relative difference beyond which a number has moved
LEVELS = ("baseline", "avx2", "avx512")
HERE = [level for level in LEVELS if level in _core.vector_levels()]
FAMILIES = ("legendre", "beam", "consistent", "midpoint", "rayleigh", "uniform", "frequency")
HOPF = "speed frequency growth detuning quadratic cubic lyapunov amplitude_law frequency_law"
OPERATORS = ("mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux")

PIPES = {
    "plain": pp.Pipe(0.2),
    "damped": pp.Pipe(0.2, damping=1e-3),
    "hanging": pp.Pipe(0.3, 12.0, drag=0.5, damping=1e-3),
    "standing": pp.Pipe(0.2, -10.0, drag=0.5),
    "buckled": pp.Pipe(0.3, -60.0),
    "heavy": pp.Pipe(0.99, 100.0, damping=1e-3),
    "beta=0": pp.Pipe(0.0, 10.0, drag=0.5),
    "aspirating": pp.Pipe(0.4, -3.0, "aspirating", 0.7, drag=1.5, damping=0.01),
    "intake": pp.Pipe(0.4, 10.0, "aspirating", 0.6, damping=1e-3),
}
FITTINGS = {"+both": (0.4, 0.3, 40.0), "+mass": (0.4, 0.5, 0.0), "+end": (1.0, 0.2, 5.0)}
RATIOS = 10.0 ** np.array([-1.5, 0.0, -3.0, -0.5, -2.0, -2.5, -1.0, -3.0])
PLACES = {"centers": [0.4, 0.6, 0.3, 0.5] * 2, "drag_points": [0.3, 1.0, 0.0, 0.7] * 2}
SEGMENTS = {
    "unequal": {"lengths": 0.9 * RATIOS / RATIOS.sum(), "base": 0.1} | PLACES,
    "own": {"springs": [9.0, 4.0, 7.0, 0.0], "gyration_radii": [0.05, 0.08, 0.02, 0.1]},
}
MOVING = """chain hanging 1; chain standing 2; chain aspirating 5 midpoint; chain intake 7 rayleigh
chain beta=0 6 uniform; chain damped 12 frequency; chain hanging 8 unequal; chain hanging 4 own
chain heavy 40; beam hanging 1; beam standing 6; beam intake 7; legendre hanging 8; scene hanging 5
legendre aspirating 6; legendre heavy 20; beam hanging 6 +both; beam beta=0 5 +end
legendre hanging 9 +mass +end; legendre aspirating 8 +both; legendre standing 6 +end
scene aspirating 6 guided; scene hanging 7 +mass +end; scene damped 4 own; scene standing 5 parts"""
LINEAR = """continuum plain; continuum hanging; continuum standing; continuum heavy
continuum intake; continuum beta=0; continuum hanging +both; continuum intake +mass +end
continuum plain +end; chain damped 100; chain hanging 1000"""
ONSETS = """chain plain 3; chain damped 5 midpoint; chain hanging 3; beam damped 4; scene damped 3
legendre damped 5; legendre damped 5 +end; legendre hanging 5 +both; chain intake 5
scene damped 5 +mass +end"""
MOVING, LINEAR, ONSETS = (x.replace("\n", "; ").split("; ") for x in (MOVING, LINEAR, ONSETS))
LINEAR = MOVING[:-1] + LINEAR  # the last rests bent


def with_fittings(pipe, fittings):
    """The pipe with point masses and springs, (at, mass, stiffness) each."""
    masses = [pp.PointMass(at, mass) for at, mass, _ in fittings if mass]
    springs = [pp.Spring(at, stiffness) for at, _, stiffness in fittings if stiffness]
    return replace(pipe, terms=(*masses, *springs))


def parts(name):
    """What a scene has besides a pipe."""
    md = pp.modular
    damper = pp.Damper(at=0.8, coefficient=0.8)
    held = pp.PointMass(at=0.4, mass=0.1), pp.Spring(at=0.6, stiffness=40.0), damper
    bent = md.TorsionalSpring(2, 3.0, damping=0.2, rest_angle=0.3)
    own = md.Custom(nodes=(3,), energy=lambda q: 5.0 * q[0] ** 4 + 2.0 * q[0] ** 2)
    return {"": (), "parts": (*held, bent), "guided": (md.Guide(6),), "own": (own,)}[name]


def made(name):
    """A model by its name: kind, pipe, size, and what it has besides."""
    kind, pipe, *more = name.split()
    given = [FITTINGS[x] for x in more if x in FITTINGS]
    pipe = with_fittings(PIPES[pipe], given)
    if kind == "continuum":
        return pp.Continuum(pipe)
    size, rest = int(more[0]), "".join(x for x in more[1:] if x not in FITTINGS)
    if kind in ("beam", "legendre"):
        return pp.Galerkin(pipe, size, kind)
    if kind == "scene":
        # the lengths that chain chose at 3ddf395, where fittings had to be at nodes
        first = [0.4 / (size // 2)] * (size // 2)
        cut = {"lengths": first + [1.2 / (size + 1)] * (size - size // 2)} if given else {}
        return pp.modular.chain(pipe, size, **cut).plus(*parts(rest))
    return pp.Chain(pipe, size, **SEGMENTS.get(rest, {"springs": rest or "consistent"}))


def uniform(seed, size):
    """Numbers in [-1, 1] by Python's own generator, whose sequence stays."""
    numbers = random.Random(seed)
    return np.array([2.0 * numbers.random() - 1.0 for _ in range(size)])


def setting(name):
    """A model at NAME @LEVEL, and states with flow speeds: one state, batches of 5 and 16."""
    name, _, level = name.partition(" @")
    _core.set_vector_level(level or LEVELS[0])
    model, found = made(name), []
    for k in range(22):
        m = model.moving
        q, rate = uniform(f"{name} {k}", 2 * m).reshape(2, m)
        if "guided" in name:  # what is odd about the middle leaves the end on the axis
            q, rate = (np.concatenate([x[: m // 2], -x[: m // 2][::-1]]) for x in (q, rate))
        if isinstance(model, pp.Galerkin):
            q, rate = (x * 0.5 * np.arange(1.0, m + 1.0) ** -2 for x in (q, rate))
        y = np.concatenate([0.7 * q, 3.0 * rate])
        found.append(model.state(*np.split(y, 2)) if name.startswith("scene") else y)
    y = np.array(found).T
    return model, ((y[:, 0], 6.0), (y[:, 1:6], 20.0), (y[:, 6:], np.linspace(0.0, 20.0, 16)))


def drawn(values, most=1):
    """Some of many numbers, evenly, and a projection of all."""
    flat = np.ravel(values).tolist()
    if len(flat) <= most + 1:
        return flat
    weights = uniform("projection", len(flat)).tolist()
    dot = math.fsum(w * x for w, x in zip(weights, flat, strict=True))
    return [*flat[len(flat) // most // 2 :: len(flat) // most][:most], dot]


# --------------------------------------------------------------------------------------- questions
# Each answers with the numbers of parts of a name; where an error is known, with (numbers, error).


def rhs(name):
    model, asked = setting(name)
    one, *more = (model.rhs(0.0, y, u)[model.coordinates :] for y, u in asked)
    return {"": [*drawn(one), *(drawn(several)[-1] for several in more)]}


def jacobian(name):
    model, asked = setting(name)
    return {"": drawn(model.jacobian(0.0, *asked[0])[model.coordinates :], 2)}


def energy(name):
    model, asked = setting(name)
    one, *more = (model.energy(y) for y, _ in asked)
    return {"": [one, drawn(np.concatenate(more))[-1]]}


def power(name):
    model, asked = setting(name)
    found = [model.power(y, u) for y, u in asked]
    names = ("flow", "joints", "drag", "others")
    found = {k: np.hstack([getattr(p, k) for p in found]) for k in names}
    return {k: drawn(rates)[-1:] for k, rates in found.items() if rates.any()}


def operators(name, way):
    model, asked = setting(name)
    found = model.operators(asked[0][0][: model.coordinates] if way else None)
    rows = {k: getattr(found, k) for k in OPERATORS}
    return {k: drawn(x) for k, x in rows.items() if np.abs(x).max() > 1e-20}  # not rounding's own


def eigenvalues(name, u):
    model = made(name)
    most = 3 if isinstance(model, pp.Continuum) else min(model.dof, 3)
    found = pp.modes(model, u, 2 * most)
    pairs = zip(found.eigenvalues[::2].tolist(), found.errors[::2].tolist(), strict=True)
    return {f"{k}": ([x.real, x.imag], error) for k, (x, error) in enumerate(pairs, 1)}


def passage(one, more, title=""):
    counts = [one.kind == "flutter", one.mode, more]
    parts = {"speed": ([one.speed], one.error), "frequency": [one.frequency], "counts": counts}
    return {title + k: v for k, v in parts.items()}


def crossings(name):
    found = pp.crossings(made(name), 20.0)
    several = (passage(one, one.unstable_after, f"{i} ") for i, one in enumerate(found[:4], 1))
    return {"number": [len(found)]} | {k: v for one in several for k, v in one.items()}


def critical_speed(name):
    try:
        found = pp.critical_speed(made(name), 60.0)
    except pp.NoCrossing:
        return {"none": [0.0]}
    parts = passage(found, found.stable_at_rest)
    if by := found.sensitivity and found.sensitivity.speed:
        parts["slopes"] = [by.beta, by.gamma, by.damping, by.alpha]
    return parts


def hopf(name):
    found = pp.hopf(made(name))
    errors = {"speed": found.crossing.error, "lyapunov": found.lyapunov_error}
    errors["amplitude_law"] = found.amplitude_error
    errors["cubic"] = found.lyapunov_error * found.frequency
    numbers = {k: getattr(found, k) for k in HOPF.split()}
    return {k: ([x.real, x.imag][: 1 + (x != x.real)], errors.get(k)) for k, x in numbers.items()}


def cycles(name):
    model = made(name)
    found = pp.limit_cycle(model, 1.05 * pp.critical_speed(model).speed)
    sizes = {k: getattr(found, k) for k in ("amplitude", "period", "frequency")}
    turns = [x for m in found.multipliers[:4].tolist() for x in (m.real, abs(m.imag))]
    worst = max(1.0, abs(found.multipliers[0])) * found.multiplier_error
    return {k: ([x], found.error * x) for k, x in sizes.items()} | {"multipliers": (turns, worst)}


def choices(pipe, question, tolerance, conditions):
    found = pp.choose(PIPES[pipe], question, tolerance, **conditions)
    values = drawn([found.answer.real, found.answer.imag], 3)
    model = [FAMILIES.index(found.family), found.size]
    return {"model": model, "answer": (values, found.error * max(map(abs, values)))}


def equilibria(name, u):
    found = pp.equilibria(made(name), u)
    tips, growth = np.sort(found.tips, axis=0)[-3:], np.sort(found.growth)[-3:]
    return {"number": [len(found), sum(found.stable)], "tips": tips.ravel(), "growth": growth}


def simulate(name, way):
    found = pp.simulate(made(name), 6.0, 0.3, lambda s: 0.3 * s, method=way, rtol=1e-8)
    ends = {"q": found.q, "qdot": found.qdot, "tip": found.tip, "energy": found.energy}
    return {k: (drawn(x[-1]), 1e-8 * np.abs(x[-1]).max()) for k, x in ends.items()}


def missing(name):
    """Whether it asks for a vector level that the processor lacks."""
    return "@" in name and name.partition("@")[2] not in HERE


SPEEDS, WAYS = (4.5, 0.0, 8.0, 20.0, 2.0), ("lsoda", "dop853", "auto", "Radau")
AT_LEVELS = [(f"{name} @{level}",) for name in MOVING for level in HERE]
BENT = ("chain hanging 8 unequal", "beam hanging 6 +both", "scene aspirating 6 guided")
MANY = [(x, u) for x in ("continuum hanging +both", "legendre heavy 20") for u in (1.0, 20.0)]
SPEED, PAIR = "critical_speed", ("consistent", "midpoint")
ASKED = (
    *(("plain", SPEED, 1e-4, {"among": PAIR}), ("hanging", SPEED, 1e-3, {})),
    *(("damped", SPEED, 1e-2, {"among": "chain"}), ("intake", SPEED, 1e-4, {"among": "beam"})),
    ("heavy", "frequencies", 1e-5, {"u": 4.0, "count": 3}),
    ("plain", "frequencies", 1e-6, {"u": 3.0, "count": 4}),
    ("intake", "root_loci", 1e-4, {"speeds": [0.0, 2.0, 4.0], "count": 2}),
    ("damped", "motion", 1e-2, {"u": 6.0, "duration": 1.0}),
    ("damped", "limit_cycle", 1e-2, {"u": 6.0, "among": "reduced"}),
)
RESTS = {"chain standing 2": 2.0, "chain buckled 3": 2.0, "scene standing 5 parts": 1.0}
RESTS |= {"legendre standing 5": 1.0, "beam buckled 4 +both": 0.5, "scene buckled 4": 2.0}
CASES = {  # questions and what they are asked with
    **dict.fromkeys((rhs, jacobian, energy, power), AT_LEVELS),
    operators: [(x, "") for x in MOVING[1::2]] + [(x, "bent") for x in BENT],
    eigenvalues: [(x, SPEEDS[i % 5]) for i, x in enumerate(LINEAR)] + MANY,
    crossings: [(x,) for x in LINEAR[::3]],
    critical_speed: [(x,) for x in LINEAR[:-1]],
    **{hopf: [(x,) for x in ONSETS], cycles: [(x,) for x in ONSETS[:8]]},
    **{choices: ASKED, equilibria: list(RESTS.items())},
    simulate: [(x, WAYS[i % 4]) for i, x in enumerate(MOVING[::2]) if "heavy" not in x],
}
GROUPS = {question.__name__: (question, cases) for question, cases in CASES.items()}


def computed(group):
    """Entries by name, numbers and tolerance in hexadecimal; no numbers where it raises."""
    (question, cases), found = GROUPS[group], {}
    for case in cases:
        name = ", ".join(str(x) for x in case if x != "")
        _core.set_vector_level(LEVELS[0])
        try:
            parts = question(*case)
        except Exception as error:
            print(f"{name} raised {error!r}")
            parts = {"": []}
        for part, given in parts.items():
            values, error = given if isinstance(given, tuple) else (given, None)
            row = [float(x).hex() for x in values], None if error is None else float(error).hex()
            entry = dict(zip(("values", "tolerance"), row, strict=True))
            found[f"{part} of {name}" if part else name] = entry
    return found


def write():
    """Writes the file; what raises, or is no number, ends it."""
    golden = {"commit": COMMIT, "numpy": np.__version__, "scipy": scipy.__version__}
    golden |= {group: computed(group) for group in GROUPS}
    text = json.dumps(golden).replace('}, "', '},\n"')
    assert not any(x in text for x in ("[]", "nan", "inf")), "some answers are no numbers"
    FILE.write_text(text + "\n")


def difference(entry, kept):
    """Numbers, those equal to the bit, relative difference, and that beside the tolerance."""
    pairs = list(zip(entry["values"], kept["values"], strict=False))
    if not len(pairs) == len(entry["values"]) == len(kept["values"]):
        return len(kept["values"]), 0, math.inf, math.inf
    found, before = np.array([[float.fromhex(x) for x in pair] for pair in pairs]).T
    far = np.nan_to_num(np.abs(found - before), nan=math.inf).max().item()
    scales = np.abs(before).max().item(), float.fromhex(kept["tolerance"] or "0")
    return len(pairs), sum(x == y for x, y in pairs), *(far / max(x, 5e-324) for x in scales)


def compare(groups, bits):
    """Number of entries that moved; prints a line for each group, and one for each of these."""
    golden, moved = json.loads(FILE.read_text()), []
    if any(map(missing, golden["rhs"])):
        print(f"note: of {', '.join(LEVELS)} only {', '.join(HERE)} are here")
    print("group            numbers  to the bit  difference  / error  moved")
    for group in groups:
        kept = {k: v for k, v in golden[group].items() if not missing(k)}
        found = computed(group)
        rows = {k: difference(found.get(k, {"values": []}), v) for k, v in kept.items()}
        off = [k for k, (n, same, far, _) in rows.items() if same < n and (bits or far > LARGEST)]
        off = [k for k in off if bits or rows[k][3] > 1.0] + [k for k in found if k not in kept]
        shares = [row[3] for k, row in rows.items() if kept[k]["tolerance"]]
        numbers, same, far, _ = np.array(list(rows.values())).T
        sums = f"{numbers.sum():8.0f}{same.sum():12.0f}{far.max():12.1e}"
        print(f"{group:16}{sums}{max(shares, default=math.nan):9.1e}{len(off):7}", flush=True)
        moved += [f"{group}: {k}: {found.get(k, 'gone')} {rows.get(k, 'new')}" for k in off]
    print(*moved, sep="\n", end="\n" if moved else "")
    return len(moved)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--group", nargs="+", choices=GROUPS, default=list(GROUPS))
    parser.add_argument("--bits", action="store_true", help="demand equality to the bit")
    parser.add_argument("--write", action="store_true", help="once, at the old commit")
    given = parser.parse_args()
    raise SystemExit(write() if given.write else compare(given.group, given.bits) > 0)
