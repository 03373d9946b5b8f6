# SPDX-License-Identifier: MIT
"""Random pipes in classes, their models, and how far they are searched.

A case is drawn as plain numbers, of which both a text of Python for the package and the elements of
`campaign_elements.py` are made. It depends on a seed and its number alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np

Numbers = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A pipe's numbers, a model of it as Python text with {} for the pipe, and the search's end."""

    name: str
    numbers: Numbers
    model: str
    end: float

    @property
    def text(self) -> str:
        """The model as Python text."""
        return self.model.format(pipe_text(self.numbers))


def rounded(x: float) -> float:
    """Few digits, so that cases can be read."""
    return float(f"{x:.6g}")


def power(rng: Random, low: float, high: float) -> float:
    """A number of which the logarithm is uniform between powers of ten."""
    return rounded(10.0 ** rng.uniform(low, high))


def pipe_text(numbers: Numbers) -> str:
    """`Pipe` of the numbers as Python text."""
    parts = []
    for name, value in numbers.items():
        if name == "terms":
            each = ", ".join(
                f"pp.{law}({', '.join(f'{k}={v!r}' for k, v in of.items())})" for law, of in value
            )
            parts.append(f"terms=[{each}]")
        elif name in ("stiffness", "mass"):
            at, series = value
            each = ", ".join(
                repr(c[0])
                if len(c) == 1
                else f"lambda s: {c[0]!r} + {c[1]!r} * s + {c[2]!r} * s**2"
                for c in series
            )
            parts.append(f"{name}=pp.Profile({at!r}, [{each}])")
        elif name == "root" and not isinstance(value, str):
            parts.append(f"root=pp.RootSpring({value!r})")
        else:
            parts.append(f"{name}={value!r}")
    return f"pp.Pipe({', '.join(parts)})"


def some_beta(rng: Random) -> float:
    return rounded(
        rng.choice([rng.uniform(0.01, 0.95), rng.uniform(0.01, 0.95), power(rng, -3, -1)])
    )


def some_gravity(rng: Random, share: float = 0.5) -> float:
    """Of hanging pipes mostly; some stand, and some of these buckle without flow."""
    if rng.random() > share:
        return 0.0
    return rounded(rng.uniform(-25.0, -5.0) if rng.random() < 0.15 else rng.uniform(-7.0, 40.0))


def some_damping(rng: Random, share: float = 0.5) -> float:
    return power(rng, -5, -1.3) if rng.random() < share else 0.0


def some_root(rng: Random) -> Any:
    return rng.choice(["clamped", "clamped", "pinned", power(rng, -1, 3)])


def some_place(rng: Random) -> float:
    return rng.choice([0.5, 1.0, rounded(rng.uniform(0.05, 0.98))])


def cantilevered(rng: Random, _: int) -> Numbers:
    made: Numbers = {
        "beta": some_beta(rng),
        "gamma": some_gravity(rng),
        "damping": some_damping(rng),
    }
    if rng.random() < 0.3:
        made["alpha"] = rounded(rng.uniform(0.0, 2.5))
    if rng.random() < 0.08:  # hardly any gyroscopic force or damping, or none
        made["beta"], made["damping"] = rng.choice([0.0, power(rng, -12, -8)]), 0.0
    return made


def held(rng: Random, _: int) -> Numbers:
    made: Numbers = {
        "beta": some_beta(rng),
        "gamma": some_gravity(rng, 0.3),
        "root": some_root(rng),
        "end": rng.choice(["pinned", "clamped"]),
    }
    if rng.random() < 0.5:
        at = {"at": rng.choice([0.5, rounded(rng.uniform(0.1, 0.9))])}
        laws = [
            ("Tension", {"load": rounded(rng.uniform(-8.0, 30.0))}),
            ("PointMass", at | {"mass": power(rng, -2, 0.5)}),
            ("Spring", at | {"stiffness": rounded(rng.uniform(0.0, 500.0))}),
            ("Spring", at | {"stiffness": power(rng, 1, 4)}),
            ("AddedMass", {"chi": power(rng, -1, 1)}),
        ]
        made["terms"] = [rng.choice(laws)]
    return made


def held_damped(rng: Random, size: int) -> Numbers:
    made = held(rng, size) | {"end": rng.choice(["guided", "pinned", "clamped"])}
    made["damping"] = power(rng, -5, -0.5)
    if rng.random() < 0.3:
        made["damping"] = 0.0
        made["terms"] = [*made.get("terms", []), ("Viscosity", {"sigma": power(rng, -2, 1)})]
    return made


def on_foundation(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, held, held, held, held_damped])(rng, size)
    kind = rng.random()
    stiffness = rng.uniform(0.0, 2500.0) if kind < 0.5 else power(rng, 0.5, 4)
    if kind > 0.8:  # about where the divergences of two modes of a hinged pipe meet
        made |= {"root": "pinned", "end": "pinned", "gamma": 0.0}
        n = rng.randint(1, 3)
        stiffness = (n * (n + 1)) ** 2 * math.pi**4 * (1.0 + rng.uniform(-0.15, 0.15))
    made["terms"] = [("Foundation", {"stiffness": rounded(stiffness)})]
    if rng.random() < 0.2:
        made["terms"].append(("Spring", {"at": some_place(rng), "stiffness": power(rng, 0, 3.5)}))
    return made


def overdamped(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, held, aspirating, aspirating])(rng, size)
    if rng.random() < 0.3:
        made["damping"] = power(rng, -1.5, 1)
    if rng.random() < 0.7 or not made.get("damping"):
        fed = made.get("flow") == "aspirating"  # such a pipe loses stability in spite of the less
        made["terms"] = [
            ("Viscosity", {"sigma": power(rng, 0.3, 1.8) if fed else power(rng, 0.5, 3)})
        ]
    if rng.random() < 0.3:
        made["terms"] = [
            *made.get("terms", []),
            ("Damper", {"at": some_place(rng), "coefficient": power(rng, 0, 3)}),
        ]
    return made


def hysteretic(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, held, held_damped, aspirating])(rng, size)
    made["hysteresis"] = power(rng, -4, -0.3)
    if rng.random() < 0.2:
        made["terms"] = [*made.get("terms", []), ("Viscosity", {"sigma": power(rng, -1, 1)})]
    return made


def aspirating(rng: Random, size: int) -> Numbers:
    made = cantilevered(rng, size) | {"flow": "aspirating"}
    made["damping"] = power(rng, -6, -1.5) if rng.random() < 0.7 else 0.0
    made["alpha"] = rng.choice([1.0, 0.0, rounded(rng.uniform(0.0, 1.5))])
    if rng.random() < 0.5:
        made["inflow_share"] = rng.choice([0.0, 0.5, rounded(rng.uniform(0.0, 1.0))])
    return made


def supported(rng: Random, size: int) -> Numbers:
    made = rng.choice([held, held, held_damped, cantilevered])(rng, size)
    made.pop("terms", None)
    spans = rng.randint(2, max(2, min(101, size // 2)))
    places = np.linspace(0.0, 1.0, spans + 1)
    if rng.random() < 0.4:
        places = np.cumsum([0.0, *(rng.uniform(0.4, 1.6) for _ in range(spans))])
        places /= places[-1]
    elif rng.random() < 0.5:
        made |= {"root": "pinned", "end": "pinned", "gamma": 0.0}
    # A chain has a segment end at each support, which decimals of nine digits meet.
    made["supports"] = [float(f"{x:.9g}") for x in places[1:-1]]
    return made


def profiled(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, cantilevered, held, held_damped, aspirating])(rng, size)
    made.pop("terms", None)

    def profile(low: float) -> tuple[list[float], list[list[float]]]:
        if rng.random() < 0.5:
            end = rng.uniform(low, 2.0)
            bend = rng.uniform(-0.3, 0.3) * (1.0 - low)
            return [], [[1.0, rounded(end - 1.0 - bend), rounded(bend)]]
        at = sorted(rounded(rng.uniform(0.1, 0.9)) for _ in range(rng.choice([1, 1, 2])))
        return at, [[1.0], *([rounded(rng.uniform(low, 2.0))] for _ in at)]

    which = rng.random()
    if which < 0.75:
        made["stiffness"] = profile(0.3)
    if which > 0.5:
        made["beta"] = rounded(min(made["beta"], 0.6))
        made["mass"] = profile(max(0.65, made["beta"]))
    return made


def with_terms(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, cantilevered, held, held_damped, aspirating])(rng, size)
    wide = rng.choice([1.0, 1.0, 1.0, 2.0, 4.0])
    laws: dict[str, Callable[[], Numbers]] = {
        "PointMass": lambda: {"at": some_place(rng), "mass": power(rng, -1 - wide, wide)},
        "Spring": lambda: {"at": some_place(rng), "stiffness": power(rng, 1 - wide, 1.5 + wide)},
        "Damper": lambda: {"at": some_place(rng), "coefficient": power(rng, -wide, wide)},
        "Foundation": lambda: {"stiffness": power(rng, 1 - wide, 1.5 + wide)},
        "Viscosity": lambda: {"sigma": power(rng, -wide, wide)},
        "AddedMass": lambda: {"chi": power(rng, -wide, wide)},
        "CubicSpring": lambda: {"at": some_place(rng), "stiffness": power(rng, 0, 4)},
        "Stop": lambda: {
            "at": some_place(rng),
            "gap": power(rng, -3, 0),
            "stiffness": power(rng, 0, 4),
        },
        "Tension": lambda: {"load": rounded(rng.uniform(-5.0, 20.0))},
        "Weight": lambda: {"at": some_place(rng), "load": rounded(rng.uniform(-5.0, 20.0))},
    }
    if made.get("end") in ("pinned", "clamped"):
        laws["Stretching"] = lambda: {"stiffness": power(rng, 0, 5)}
    names = rng.sample(sorted(laws), rng.choice([1, 1, 2, 3]))
    made["terms"] = [(name, laws[name]()) for name in names]
    return made


def with_couples(rng: Random, size: int) -> Numbers:
    """What turns with the pipe or holds its rotation."""
    made = rng.choice([cantilevered, cantilevered, held, held_damped, aspirating])(rng, size)
    laws: list[tuple[str, Numbers]] = [
        ("RotationalSpring", {"stiffness": power(rng, -1, 2)}),
        ("RotationalDamper", {"coefficient": power(rng, -2, 1)}),
        ("PointMass", {"mass": power(rng, -2, 0), "inertia": power(rng, -4, -1)}),
    ]
    some = rng.sample(laws, rng.choice([1, 1, 2]))
    # An end that keeps its direction has no rotation, but the last segment of a chain has.
    last = 0.95 if made.get("end") in ("guided", "clamped") else 1.0
    made["terms"] = [(law, {"at": min(some_place(rng), last), **of}) for law, of in some]
    return made


CLASSES: dict[str, Callable[[Random, int], Numbers]] = {
    "cantilevered": cantilevered,
    "held": held,
    "held and damped": held_damped,
    "on foundations": on_foundation,
    "overdamped": overdamped,
    "hysteretic": hysteretic,
    "aspirating": aspirating,
    "with supports": supported,
    "profiles": profiled,
    "with terms": with_terms,
    "with couples": with_couples,
}


def energy_paths(numbers: Numbers) -> tuple[bool, bool]:
    """Whether no energy passes an end of the pipe, and whether anything dissipates."""
    end = numbers.get("end", "free")
    held = end in ("pinned", "clamped")
    carried = numbers["beta"] * numbers.get("inflow_share", 1.0) > 0.0
    follows = numbers.get("alpha", 1.0) > 0.0 and end != "guided"
    still = {*numbers.get("supports", ()), *([1.0] if held else [])}
    damps = [
        law in ("Viscosity", "RotationalDamper") or (law == "Damper" and of["at"] not in still)
        for law, of in numbers.get("terms", ())
    ]
    return held or not (carried or follows), any(
        (numbers.get("damping", 0.0), numbers.get("hysteresis", 0.0), *damps)
    )


def some_size(rng: Random, band: int) -> int:
    """Degrees of freedom: of 100 cases 90 have up to 40, mostly few, 9 up to 120 and one more."""
    if band == 0:
        return rng.randint(121, 400)
    if band < 10:
        return rng.randint(41, 120)
    return rng.choice(
        [
            *[rng.randint(2, 6)] * 10,
            *[rng.randint(7, 14)] * 7,
            rng.randint(15, 24),
            rng.randint(15, 40),
        ]
    )


def drawn(seed: int, index: int, names: list[str]) -> Case:
    """The case of a number."""
    rng = Random(f"{seed} {index}")
    name, band = names[index % len(names)], index // len(names) * 37 % 100
    size = some_size(rng, band)
    numbers = CLASSES[name](rng, size)
    if not (restored := numbers.get("end", "free") != "free" or "supports" in numbers):
        restored = numbers.get("root", "clamped") != "pinned"
    if not restored:  # a pipe free to turn is neutral at every speed
        numbers["gamma"] = rounded(rng.uniform(1.0, 40.0))
    model = some_model(rng, numbers, size)
    return Case(name, numbers, model, rounded(some_end(rng, numbers)))


def some_end(rng: Random, numbers: Numbers) -> float:
    """How far to search: to about twice the first loss."""
    spans = len(numbers.get("supports", ())) + 1
    if spans > 1:
        return spans * rng.uniform(2.5, 5.0 if spans < 10 else 3.6 if spans < 30 else 3.25)
    foundation = sum(
        of.get("stiffness", 0.0) for law, of in numbers.get("terms", ()) if law == "Foundation"
    )
    scale = (1.0 + foundation / 100.0) ** 0.25
    return rng.uniform(4.0, 15.0) * min(scale, 4.0)


def some_model(rng: Random, numbers: Numbers, size: int) -> str:
    """Text of a model with {} for its pipe."""
    spans = len(numbers.get("supports", ())) + 1
    joints = {of["at"] for _, of in numbers.get("terms", ()) if of.get("at", 1.0) < 1.0}
    joints |= {s for name in ("stiffness", "mass") if name in numbers for s in numbers[name][0]}
    kind = rng.random()
    # Of an undamped aspirating pipe all modes grow at once, and no reference has them all.
    bounded = numbers.get("flow") != "aspirating" or numbers["damping"] > 0.0
    if kind > 0.85 and bounded and (spans <= 12 or size > 120):
        return "pp.Continuum({})"
    if kind < 0.5:
        n = max(2 * spans, size + spans - 1)
        plain = spans == 1 and numbers.get("root", "clamped") == "clamped"
        rules = ["consistent", "consistent", "uniform", "rayleigh", "frequency"]
        if plain and numbers.get("end", "free") in ("free", "pinned"):
            rules.append("midpoint")
        rule = rng.choice(rules)
        if spans == 1 and rng.random() < 0.25 and rule != "midpoint":
            lengths = np.array([rng.uniform(0.5, 1.5) for _ in range(n)])
            listed = [float(f"{x:.12g}") for x in lengths / lengths.sum()]
            extra = f", lengths={listed}"
            if rng.random() < 0.4:
                directed = numbers.get("end", "free") in ("clamped", "guided")
                springs = [rounded(n * rng.uniform(0.6, 1.7)) for _ in range(n + directed)]
                return f"pp.Chain({{}}, springs={springs}{extra})"
            return f"pp.Chain({{}}, springs={rule!r}{extra})"
        return f"pp.Chain({{}}, {n}, springs={rule!r})"
    basis = "legendre" if rng.random() < 0.55 else "beam"
    least = len(joints) + spans + 2
    m = max(min(size, 200), least if basis == "legendre" else 2)
    return f"pp.Galerkin({{}}, {m}, {basis!r})"
