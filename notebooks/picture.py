# SPDX-License-Identifier: MIT
"""Draws the README's picture: `python notebooks/picture.py` in an environment with the package."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pipedyn as pp
from pipedyn import plot

hose = pp.Pipe.from_si(
    length=0.45, bending_stiffness=7.3e-3, pipe_mass=0.19, fluid_mass=0.032, damping_time=2e-3
)
chain = pp.Chain(hose, 20)
onset = pp.critical_speed(chain)
motion = pp.simulate(chain, 1.1 * onset.speed, 30.0, lambda s: 0.1 * s)
loci = pp.root_loci(chain, np.linspace(0.0, 1.2 * onset.speed, 121), count=3)
window = {"beta": (0.02, 0.95), "u": (0.0, 20.0)}

figure, axes = plt.subplots(1, 3, figsize=(8.4, 3.3), layout="constrained")
plot.snapshots(motion, units="si", ax=axes[0])
plot.root_loci(loci, ax=axes[1])
plot.colour_bar("flow speed $u$", ax=axes[1])
stable = pp.boundary(pp.Continuum(pp.Pipe(0.2)), "beta", "u", window)
plot.boundary(stable, legend=False, ax=axes[2])
axes[0].set_title(f"A hose at {hose.speed_si(motion.u):.1f} m/s")
axes[1].set_title("Its eigenvalues")
axes[2].set(title="Stable pipes (shaded)", xlabel=r"mass ratio $\beta$", ylabel="flow speed $u$")
figure.savefig(Path(__file__).with_name("picture.png"), dpi=144)
