# SPDX-License-Identifier: MIT
"""Time and memory of maps of pipes, alone, in a cluster and into files; fails on an error only.

Run with `.venv/bin/python tests/benchmark_maps.py [pipes]` after `pip install
"dask[array,dataframe,distributed]" zarr pyarrow`; pytest does not collect it. Needs Linux, which
tells the largest memory that a process has had. What goes into files is the code of the page
`notebooks/how-to/sweep-in-parallel.md`, with fewer pipes.
"""

from __future__ import annotations

import logging
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from distributed import Client, LocalCluster
from measuring import check, ended, machine

import pipedyn as pp

CHAIN = pp.Chain(pp.Pipe(0.2), 10)
WORKERS, EMPTY = 2, 1000
PAGE = Path(__file__).parents[1] / "notebooks" / "how-to" / "sweep-in-parallel.md"
BETAS = "0.01, 0.95, 1000"
"""Ends and number of the mass ratios in the page's code, for each of which it has 1000 pipes."""


def numbers(pipes: int) -> dict[str, Any]:
    """Values of beta and gamma of a map with some `pipes` points."""
    side = round(pipes**0.5)
    return {
        "beta": np.linspace(0.01, 0.95, side)[:, None],
        "gamma": np.linspace(0.0, 50.0, side),
    }


def most_memory(process: int | str = "self") -> float:
    """Largest memory that a process has had, in MB; `ru_maxrss` would begin with its parent's."""
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def spent(call: Callable[[], Any]) -> tuple[Any, float, float]:
    """What a call returns, its time and the processor time of this process."""
    wall, own = time.perf_counter(), time.process_time()
    made = call()
    return made, time.perf_counter() - wall, time.process_time() - own


def report(name: str, pipes: int, wall: float, own: float, memory: str) -> None:
    print(f"  {name:27s} {pipes:8d} {1e3 * wall / pipes:9.3f} {1e3 * own / pipes:11.3f}  {memory}")


def alone_and_together(wanted: int) -> None:
    """One process with its threads, and a cluster as the executor."""
    given = numbers(wanted)
    pp.critical_speeds(CHAIN, {name: values.ravel()[:100] for name, values in given.items()})
    before = most_memory()
    alone, wall, own = spent(lambda: pp.critical_speeds(CHAIN, given))
    pipes = alone.speeds.size
    grown = most_memory() - before
    report("one process, its threads", pipes, wall, own, f"{1e3 * grown / pipes:.2f} kB a pipe")
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
        before = sum(client.run(time.process_time).values())
        together, wall, client_s = spent(lambda: pp.critical_speeds(CHAIN, given, executor=client))
        workers = sum(client.run(time.process_time).values()) - before
        said = f"{1e3 * client_s / pipes:.3f} ms of it the client and scheduler"
        report(f"cluster, {WORKERS} processes", pipes, wall, client_s + workers, said)
        _, empty, _ = spent(lambda: client.gather(client.map(abs, range(EMPTY), pure=False)))
    print(f"  {1e3 * empty / EMPTY:.2f} ms for each of {EMPTY} empty tasks of the cluster")
    check(float(np.nanmax(np.abs(together.speeds - alone.speeds))), 0.0, "answers of the cluster")
    check(float(np.nanmax(alone.errors)), 1e-6, "errors of the speeds")
    check(float(len(alone.failures)), 0.0, "failures")


def into_files(name: str, code: str, pipes: int) -> None:
    """The page's code in a new process, with the largest memory of that process and a worker."""
    betas = 20 * max(pipes // 20_000, 1)  # as many as make whole tasks
    pipes, code = 1000 * betas, code.replace(BETAS, f"0.01, 0.95, {betas}")
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "script.py"
        script.write_text(code, encoding="utf-8")
        begun, memory, processor = time.perf_counter(), dict[int, float](), dict[int, float]()
        process = psutil.Popen([sys.executable, str(script)], cwd=folder)
        while process.poll() is None:
            for one in [process, *process.children(recursive=True)]:
                try:
                    memory[one.pid] = most_memory(one.pid)
                    processor[one.pid] = sum(one.cpu_times()[:2])
                except (psutil.Error, OSError, IndexError):  # it has just ended
                    continue
            time.sleep(0.05)
        wall = time.perf_counter() - begun
    check(float(process.returncode), 0.0, f"status of the code for {name}")
    own = memory.pop(process.pid)
    said = f"{own:.0f} MB, a worker {max(memory.values()):.0f} MB"
    report(name, pipes, wall, sum(processor.values()), said)


def main() -> int:
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    print(machine())
    print("critical speeds of chains of 10 segments, beta 0.01 to 0.95, gamma 0 to 50")
    print("  route                          pipes ms a pipe, of processor  other")
    alone_and_together(wanted)
    root = os.pathsep.join([str(Path(pp.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    os.environ["PYTHONPATH"] = root  # of the new processes
    blocks = PAGE.read_text(encoding="utf-8").split("```python\n")[1:]
    for kind in ("zarr", "parquet"):
        (code,) = (text for text in (b.split("```")[0] for b in blocks) if f"to_{kind}" in text)
        for pipes in (wanted // 5, wanted):
            into_files(f"into {kind}, with its start", code, pipes)
    return ended()


if __name__ == "__main__":
    sys.exit(main())
