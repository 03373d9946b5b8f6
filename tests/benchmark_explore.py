# SPDX-License-Identifier: MIT
"""Time from a move of a slider to the new pictures: `python tests/benchmark_explore.py`.

Random moves of random sliders. The time is the processor's, without what the notebook and the
browser take.
"""

import time

import numpy as np

import pipedyn as pp
from pipedyn import plot

MOVES = 200

PIPE = pp.Pipe(
    0.4,
    -5.0,
    terms=[pp.PointMass(0.7, 0.1), pp.Spring(0.5, 10.0)],
    root=pp.RootSpring(5.0),
)


def moved(state, slider, share):
    """Milliseconds from a move to a share of a slider's range, to the pixels and the film."""
    value = slider.low + share * (slider.high - slider.low)
    begin = time.process_time()
    state.set(slider.name, round(value) if slider.name == "segments" else value)
    state.picture.png()
    state.picture.overlay()
    return 1e3 * (time.process_time() - begin)


def main():
    rng, state = np.random.default_rng(1), plot.Exploration(PIPE)
    state.picture.png()
    times = {slider.name: [] for slider in state.sliders}
    for slider in rng.choice(np.array(state.sliders, dtype=object), MOVES):
        times[slider.name].append(moved(state, slider, rng.random()))
    for name, some in times.items():
        print(f"{name}: median {np.median(some):.0f} ms, worst {max(some):.0f} ms")


if __name__ == "__main__":
    main()
