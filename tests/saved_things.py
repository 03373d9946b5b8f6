# SPDX-License-Identifier: MIT
"""One small thing of every kind that `save` writes, and what it knows, number by number.

The folder `saved` beside this script holds a file of each and, in `facts.json`, what each knew when
it was written. Most of these files were written by commit 5e7fa04; all are loaded ever after and
never written anew. When a class is new, put a thing of it into `NEW`: `python
tests/saved_things.py` writes what the folder does not have yet.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import pipedyn as pp

FOLDER = Path(__file__).parent / "saved"
FACTS = FOLDER / "facts.json"

THINGS = sorted(json.loads(FACTS.read_text("utf-8")))
"""Names of the things that have a file, by which `path_of` finds it."""

NEW: dict[str, Callable[[], Any]] = {
    "RotatingMotion": lambda: pp.rotating_motion(pp.Chain(pp.Pipe(0.2), 3, dimensions=3), 6.0),
    "RotatingBranch": lambda: pp.bifurcation_diagram(
        pp.Chain(pp.Pipe(0.2), 2, dimensions=3), [4.0, 5.0]
    ).rotating[0],
    "SpatialGalerkin": lambda: pp.Galerkin(pp.Pipe(0.2, 3.0), 3, "legendre", dimensions=3),
    "SpatialHopf": lambda: pp.hopf(pp.Chain(pp.Pipe(0.3), 3, dimensions=3)),
    "CriticalSpeeds": lambda: pp.critical_speeds(
        pp.Chain(pp.Pipe(0.2), 3), {"beta": [[0.1], [0.3]], "gamma": [0.0, 2.0]}
    ),
    "pipe of a tube": lambda: pp.Pipe.from_tube(
        **{"length": 0.5, "outer_diameter": 12e-3, "inner_diameter": 8e-3},
        **{"youngs_modulus": 3e6, "density": 1150.0, "fluid_density": 998.0},
    ),
    "ForcedResponse of a force": lambda: pp.forced_response(
        pp.Chain(pp.Pipe(0.2, 3.0, damping=0.02), 2),
        1.0,
        force=pp.Force(at=0.7, frequency=5.0, amplitude=0.1),
    ),
    "pipe with phases": lambda: pp.Pipe.from_tube(
        **{"length": 0.5, "outer_diameter": 12e-3, "inner_diameter": 8e-3},
        **{"youngs_modulus": 3e6, "density": 1150.0},
        phases=[pp.Phase(998.0, 2e-4), pp.Phase(1.2, 1e-4, slip=1.5)],
    ),
}
"""How a thing without a file is made, by its name; an exception is put into a `Failure`."""

# ------------------------------------------------------------------------------------------ facts

CALLED = {"Mechanism": "PipedynError", ", 'udwadia-kalaba'": ""}
"""What classes, attributes and words are called today that `facts.json` has under an older name."""

STATE = "rates of a bent state"


def facts(thing):
    """All that a thing knows: class, numbers and words by where they are, as JSON takes them.

    Of an array two sums of its entries are told, exactly rounded. Of a model what it
    answers. What is met again is not told again.
    """
    found, met = {}, {}
    _add(thing, "", found, met)
    return found


def _add(value, where, found, met):
    if value is None or isinstance(value, bool | int | str):
        found[where] = value
    elif isinstance(value, float):
        found[where] = value if math.isfinite(value) else repr(value)
    elif isinstance(value, complex):
        found[where] = [repr(value.real), repr(value.imag)]
    elif isinstance(value, np.generic):
        _add(value.item(), where, found, met)
    elif isinstance(value, np.ndarray):
        found[where] = _of_array(value)
    elif isinstance(value, tuple | list) or id(value) not in met:
        met[id(value)] = value  # which keeps it in memory
        found[f"{where}:"] = type(value).__name__
        for name, part in _parts(value):
            _add(part, f"{where}.{name}" if where else name, found, met)


def _of_array(values):
    """Shape, kind, words, or how many numbers are not finite and the sums of the others."""
    told = [list(values.shape), values.dtype.kind]
    each = values.ravel()
    if values.dtype.kind == "U":
        return told + each.tolist()
    for part in (each.real, each.imag)[: 1 + (values.dtype.kind == "c")]:
        numbers = [x for x in part.astype(float).tolist() if math.isfinite(x)]
        ramp = math.fsum(k * x for k, x in enumerate(numbers, 1))
        told += [part.size - len(numbers), math.fsum(numbers), ramp]
    return told


def _parts(value):
    """What is in a value, by names."""
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        yield "length", len(value)
        yield from enumerate(value)
    elif isinstance(value, tuple):
        yield from value._asdict().items()
    elif isinstance(value, dict):
        yield from value.items()
    elif isinstance(value, BaseException):
        yield "said", str(value)
        yield "args", value.args
    elif isinstance(value, pp.Model | pp.Continuum):
        yield from _answers(value)
    elif dataclasses.is_dataclass(value):
        yield from ((item.name, getattr(value, item.name)) for item in dataclasses.fields(value))
    else:  # the equations of a branch of orbits, and the motion in them
        names = ("motion", "start", "control", "unit", "model", "forcing", "order", "weights")
        known = [(name, getattr(value, name)) for name in names if hasattr(value, name)]
        assert known, value
        yield from known


def _answers(model):
    """What a model is, and what it says of a bent state."""
    yield "pipe", model.pipe
    yield "shown", repr(model)
    yield "approximates_pipe", model.approximates_pipe
    if isinstance(model, pp.Continuum):
        yield "dof", model.frozen(12).dof
        return
    yield "dof", model.dof
    yield "coordinates", model.coordinates
    if isinstance(model, pp.Chain):
        arrays = ("lengths", "springs", "centres", "gyration_radii", "drag_points", "masses")
        yield from ((name, getattr(model, name)) for name in (*arrays, "base"))
    q = np.asarray(model.bent(lambda s: 0.1 * np.sin(3.0 * s)))
    rates = model.rhs(0.0, np.concatenate([q, 0.0 * q]), 2.0)
    yield STATE, [float(rate) for rate in rates[q.size :]]
    if model._about_shown:
        yield "unbalanced", float(model.unbalanced(2.0))


def recorded():
    """What each thing knew when its file was written, under today's names."""
    found = {}
    for name, known in json.loads(FACTS.read_text("utf-8")).items():
        text = json.dumps(known)
        for before, today in CALLED.items():
            text = text.replace(before, today)
        found[name] = json.loads(text)
    return found


def differences(one, other):
    """Where facts differ from others by more than rounding of what models compute.

    What the others do not have is a field that came later.
    """
    return [
        (where, one.get(where), other.get(where))
        for where in sorted(other)
        if not _near(where, one.get(where), other.get(where))
    ]


def _near(where, one, other):
    computed = STATE in where or where.endswith("unbalanced")
    if computed and isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)
    return one == other


def path_of(name):
    """Of the file of a thing."""
    return FOLDER / f"{name.replace(' ', '-')}.npz"


def names_in(path):
    """Names of classes that a file has, as it has them."""

    def within(value):
        if isinstance(value, dict):
            for key, one in value.items():
                if key in ("class", "parts", "error", "named") and isinstance(one, str):
                    yield one
                yield from within(one)
        elif isinstance(value, list):
            for one in value:
                yield from within(one)

    with np.load(path) as file:
        return set(within(json.loads(str(file["header"]))["objects"]))


def main():
    told = json.loads(FACTS.read_text("utf-8"))
    for name, make in NEW.items():
        path = path_of(name)
        if not path.exists():
            thing = make()
            thing.save(path)
            told[name] = facts(pp.load(path))
            assert not differences(told[name], facts(thing)), name
            print(f"{path.stat().st_size:7d} {len(told[name]):5d}  {name}", flush=True)
    FACTS.write_text(json.dumps(told, sort_keys=True).replace("}, ", "},\n") + "\n", "utf-8")


if __name__ == "__main__":
    main()
