# SPDX-License-Identifier: MIT
"""Hints in error messages: what an unknown word or argument probably means."""

from __future__ import annotations

import difflib
import functools
import inspect
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from types import FunctionType
from typing import Any, TypeVar

Public = TypeVar("Public")

SYNONYM_GROUPS = """
    clamped fixed builtin cantilever cantilevered encastre encastred rigid clamp, pinned hinged
    hinge pin simplysupported simple, guided sliding slider slidingclamp, ejecting discharging
    downwards outflow, aspirating sucking suction intake inflow, legendre polynomial, beam modes
    modal, radau implicit stiff radauiia bdf lsoda, dop853 explicit rk rk45 dopri5, n m segments
    nsegments numberofsegments elements nelements modes nmodes functions order dof count k number,
    beta massratio, gamma gravity weight, alpha endcoefficient, damping delta kelvinvoigt
    viscoelasticity internaldamping materialdamping dampingtime eps epsilon, hysteresis mu
    lossfactor structuraldamping, drag kappa dragcoefficient cd, viscosity sigma viscousdamping
    externaldamping, jetangle psi nozzleangle, rotaryinertia j rotatoryinertia, chi addedmass,
    bendingstiffness ei flexuralrigidity flexuralstiffness rigidity stiffness, youngsmodulus e
    youngmodulus modulus, length l, pipemass mup mp m, fluidmass muf mf m, fluiddensity rhof rho,
    density rho rhop pipedensity, gravity g, outerdiameter externaldiameter od do diameter,
    innerdiameter internaldiameter id di bore diameter, externaldensity rhoe, addedmasscoefficient
    cm addedmass, clampcompliance compliance, clampstiffness rootstiffness, root start left bc
    boundaryconditions clamp, end tip right bc boundaryconditions, at place position location s x
    xi, stiffness k, coefficient c damping dampingcoefficient, mass m pointmass, load force tension,
    supports pins, terms forces loads springs dampers masses, springs stiffness jointstiffness,
    centres centroids centersofmass, u v speed velocity flowspeed flowvelocity flow speeds, speed u
    v velocity flowspeed, speeds u v velocities, maxspeed umax maxu speedmax vmax, duration tend
    tmax tfinal t time tspan, q0 initial initialcondition initialstate start y0 x0 theta0 state,
    qdot0 v0 initialvelocity rates, samples nsamples npoints points steps nsteps, times t time
    tspan, rtol tol tolerance, tolerance tol rtol, atol abstol, method solver integrator, base
    shaker basemotion excitation, executor pool njobs workers parallel, progress verbose, count n
    nmodes modes number, frequency freq frequencies omega, frequencies freqs freq omega frequency
    naturalfrequencies eigenfrequencies, decayrate decay, decrement logdec logdecrement
    logarithmicdecrement dampingratio zeta, criticalspeed ucr uc flutterspeed flutter
    criticalvelocity, criticalfrequency omegac flutterfrequency, criticalspeed divergencespeed,
    start transient skip, decibels db, ranges limits window bounds range, bounds limits range, x
    transverse lateral horizontal, y axial vertical, seconds time, uncertainty sigma std sd
    error, gap clearance, ax axes axis, bar legend colorbar colourbar, si siunits
"""
"""Words of the field for the same thing, as `bare` writes them; commas separate groups."""

SYNONYMS = [frozenset(group.split()) for group in SYNONYM_GROUPS.split(",")]

MOST_MEANT = 3
"""Largest number of options in a hint: more are no hint."""


ONE_AT_A_TIME = "; ask for one at a time,"


def bare(word: str) -> str:
    """A word without capitals, blanks and marks."""
    return re.sub(r"[\W_]+", "", word[:60].lower())


def did_you_mean(word: str, options: Iterable[str]) -> str:
    """The text ": did you mean 'clamped'?" with the options that a word may stand for, or "".

    They are those that differ by capitals and marks only; else those that mean the same, where a
    name with a dot, such as "Spring.stiffness", also has its last part as a name; else one that
    begins with the word or is spelled nearly like it.
    """
    given, known = bare(word), {option: bare(option) for option in options}
    meaning = {given}.union(*(group for group in SYNONYMS if given in group))
    found = [option for option, name in known.items() if name == given]
    found = found or [
        option
        for option, name in known.items()
        if name in meaning or bare(option.rpartition(".")[2]) in meaning
    ]
    if not found:
        likeness = 0.6 if len(meaning) == 1 else 0.8  # a word with a meaning is seldom misspelled
        begin = [name for name in known.values() if len(given) > 2 and name.startswith(given)]
        similar = begin or difflib.get_close_matches(given, known.values(), 1, likeness)
        found = [option for option, name in known.items() if name in similar][:1]
    found.sort(key=lambda option: "[" in option)  # Spring.stiffness before terms[0].stiffness
    return f": did you mean {' or '.join(map(repr, found[:MOST_MEANT]))}?" if found else ""


def with_hints(one: Public, package: str) -> Public:
    """A public function or class of a package, whose TypeErrors say what was probably meant.

    A function is returned as another one that calls it; the constructors of a class are replaced in
    the class itself. Exceptions and results, which users do not make, are left as they are.
    """
    shown = package.replace("pipedyn", "pp")
    if isinstance(one, FunctionType):
        hinting: Any = _hinting(one, f"{shown}.{one.__name__}")
        hinting.__module__ = package  # where it is found when it is pickled
        return hinting
    if not isinstance(one, type) or not one.__module__.startswith("pipedyn."):
        return one
    # Results have in_si; those that check what they are given, as StartPlane does, users make, too.
    made_by_users = hasattr(one, "__post_init__") or not hasattr(one, "in_si")
    if made_by_users and not issubclass(one, BaseException | tuple):
        for name, of in list(vars(one).items()):
            if hasattr(getattr(of, "__func__", of), "__wrapped__"):
                continue  # another package has the class, too
            if name == "__init__":
                setattr(one, name, _hinting(of, f"{shown}.{one.__name__}"))
            elif isinstance(of, classmethod) and not name.startswith("_"):
                called = _hinting(of.__func__, f"{shown}.{one.__name__}.{name}")
                setattr(one, name, classmethod(called))
    return one


def _hinting(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """The function, with TypeErrors that say what the caller probably meant."""

    @functools.wraps(function)
    def hinting(*args: Any, **given: Any) -> Any:
        __tracebackhide__ = True  # IPython and pytest leave this frame out
        try:
            return function(*args, **given)
        except TypeError as error:
            traceback = error.__traceback__
            if traceback is not None and traceback.tb_next is None:  # the call itself failed
                if unknown := unknown_argument(name, given, _parameters(function)):
                    raise TypeError(unknown) from None
            elif of_each := _one_at_a_time(function, name, args, given, str(error)):
                error.args = (str(error).partition(ONE_AT_A_TIME)[0] + of_each,)
            raise

    return hinting


def _parameters(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """The parameters that callers name."""
    every = inspect.signature(function).parameters
    return {name: one for name, one in every.items() if name not in ("self", "cls")}


def unknown_argument(function: str, given: Iterable[str], known: Collection[str]) -> str:
    """A sentence on the first argument that a function does not know; empty if there is none."""
    for word in given:
        if word not in known:
            hint = did_you_mean(word, known) or f", only {', '.join(known)}"
            return f"{function}() has no argument {word!r}{hint}"
    return ""


def _one_at_a_time(
    function: Callable[..., Any],
    name: str,
    args: tuple[Any, ...],
    given: Mapping[str, Any],
    message: str,
) -> str:
    """How to ask for several objects where a function takes one; empty if none was given so."""
    first = next(iter(_parameters(function).values()), None)
    if first is None or "Sequence" in str(first.annotation):
        return ""
    bound = inspect.signature(function).bind_partial(*args, **given).arguments
    several = bound.get(first.name)
    if not isinstance(several, list | tuple) or not several:
        return ""
    of_package = all(type(one).__module__.startswith("pipedyn.") for one in several)
    if not (of_package and message.startswith(f"{first.name} must be ")):
        return ""
    others = ", ..." if len({*bound} - {"self", "cls"}) > 1 else ""
    return f"{ONE_AT_A_TIME} [{name}({first.name}{others}) for {first.name} in ...]"
