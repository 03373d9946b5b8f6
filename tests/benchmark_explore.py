# SPDX-License-Identifier: MIT
"""Time from a move of a slider to the new pictures: `python tests/benchmark_explore.py`.

Random moves of random sliders; what each leaves is checked first against the public functions. The
time is that of the process, without what the notebook and the browser take.
"""

import time

import numpy as np

import pipedyn as pp
from pipedyn import plot

MOVES = 200

PIPES = {
    "cantilever": pp.Pipe(0.2, 10.0, damping=0.01),
    "mass, spring and root that gives": pp.Pipe(
        0.4,
        -5.0,
        terms=[pp.PointMass(0.7, 0.1), pp.Spring(0.5, 10.0)],
        root=pp.RootSpring(5.0),
    ),
}


def error(state):
    """Largest relative distance of what is shown from what the public functions answer."""
    pipe, n = state.model.pipe, round(state.values["segments"])
    model = pp.Chain(pipe, n)
    found = [mode.eigenvalue for mode in state.modes]
    exact = pp.eigenvalues(model, state.values["u"])
    exact = exact[exact.imag >= 0.0]
    return float(np.max(np.abs(np.array(found) - exact) / (1.0 + np.abs(exact))))


def moved(state, rng):
    """Seconds of the processor and of the clock from a random move to the pixels and the film."""
    slider = state.sliders[rng.integers(len(state.sliders))]
    value = rng.uniform(slider.low, slider.high)
    if slider.name == "segments":
        value = round(value)
    busy, clock = time.process_time(), time.perf_counter()
    state.set(slider.name, value)
    state.picture.png()
    state.picture.overlay()
    return time.process_time() - busy, time.perf_counter() - clock, slider.name


def main():
    for label, pipe in PIPES.items():
        rng = np.random.default_rng(1)
        state = plot.Exploration(pipe)
        state.picture.png()
        times, errors = [], []
        for _ in range(MOVES):
            times.append(moved(state, rng))
            errors.append(error(state))
        busy, clock = (1e3 * np.array([one[k] for one in times]) for k in (0, 1))
        print(f"{label}, {MOVES} moves, error of eigenvalues {max(errors):.0e}")
        for what, of in ("processor", busy), ("clock", clock):
            print(f"  {what}: median {np.median(of):.0f} ms, worst {of.max():.0f} ms")
        for name in state.values:
            of = busy[[one[2] == name for one in times]]
            print(f"    {name}: median {np.median(of):.0f} ms, worst {of.max():.0f} ms")


if __name__ == "__main__":
    main()
