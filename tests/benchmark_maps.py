# SPDX-License-Identifier: MIT
"""Time and memory of maps of pipes, alone and in a cluster; prints, and fails on an error only.

Run with `.venv/bin/python tests/benchmark_maps.py [pipes]`; pytest does not collect it.
"""

from __future__ import annotations

import logging
import resource
import sys
import time
from typing import Any

import numpy as np
from distributed import Client, LocalCluster
from measuring import check, ended, machine

import pipedyn as pp

CHAIN = pp.Chain(pp.Pipe(0.2), 10)
WORKERS = 2


def numbers(pipes: int) -> dict[str, Any]:
    """Values of beta and gamma of a map with some `pipes` points."""
    side = round(pipes**0.5)
    return {
        "beta": np.linspace(0.01, 0.95, side)[:, None],
        "gamma": np.linspace(0.0, 50.0, side),
    }


def resident() -> float:
    """Largest memory that the process has had, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def spent(call: Any) -> tuple[Any, float, float]:
    """What a call returns, its time and the processor time of this process."""
    wall, own = time.perf_counter(), time.process_time()
    made = call()
    return made, time.perf_counter() - wall, time.process_time() - own


def report(name: str, pipes: int, wall: float, own: float, memory: float) -> None:
    print(f"  {name:34s} {1e3 * wall / pipes:8.4f} {1e3 * own / pipes:10.4f} {memory:9.1f}")


def main() -> int:
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    print(machine())
    given = numbers(wanted)
    pp.critical_speeds(CHAIN, {name: values.ravel()[:100] for name, values in given.items()})
    before = resident()
    alone, wall, own = spent(lambda: pp.critical_speeds(CHAIN, given))
    pipes = alone.speeds.size
    print(f"critical speeds of {pipes} chains of 10 segments, beta 0.01 to 0.95, gamma 0 to 50")
    print("  route                              ms a pipe  processor  MB in all")
    report("one process, its threads", pipes, wall, own, resident() - before)
    with (
        LocalCluster(
            n_workers=WORKERS,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=logging.ERROR,
        ) as cluster,
        Client(cluster) as client,
    ):
        client.run(lambda: __import__("pipedyn").critical_speeds(CHAIN, {"beta": 0.2}))
        held = client.run(resident)
        together, wall, own = spent(lambda: pp.critical_speeds(CHAIN, given, executor=client))
        grown = [after - held[name] for name, after in client.run(resident).items()]
    report(f"cluster, {WORKERS} processes", pipes, wall, own, max(grown))
    print("  (of the cluster: processor time of this process, largest growth of a worker)")
    check(float(np.nanmax(np.abs(together.speeds - alone.speeds))), 0.0, "answers of the cluster")
    check(float(np.nanmax(alone.errors)), 1e-6, "errors of the speeds")
    check(float(len(alone.failures)), 0.0, "failures")
    return ended()


if __name__ == "__main__":
    sys.exit(main())
