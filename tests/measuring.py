# SPDX-License-Identifier: MIT
"""What the benchmarks share: shortest times, errors held against limits, the machine's name.

Times are processor times of this thread, each the least of several: other work on the machine
interrupts them but hardly lengthens them. What runs on several threads asks for another clock.
"""

from __future__ import annotations

import platform
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

import pipedyn as pp
from pipedyn import _core

Answer = TypeVar("Answer")

failures: list[str] = []


def timed(
    call: Callable[[], Answer],
    seconds: float = 0.3,
    clock: Callable[[], float] = time.thread_time,
) -> tuple[Answer, float]:
    """The answer of a call and its shortest time, s, among those that fit into so many seconds.

    Calls of less than a millisecond are timed in groups of some milliseconds.
    """
    start = clock()
    answer = call()
    best = clock() - start
    inner = max(1, int(2e-3 / (best + 1e-9)))
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        start = clock()
        for _ in range(inner):
            answer = call()
        best = min(best, (clock() - start) / inner)
    return answer, best


def cost_of(call: Callable[[], object], seconds: float = 0.3) -> float:
    """The shortest time of a call alone, s."""
    return timed(call, seconds)[1]


def check(error: float, limit: float, what: str) -> None:
    if not error <= limit:
        failures.append(f"{what}: error {error:.1e} is not within {limit:.0e}")


def processor() -> str:
    """Its name; on Linux the kernel's, with the numbers of its family and model."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    told = {name.strip(): value.strip() for name, _, value in (x.partition(":") for x in lines)}
    if "cpu family" in told:
        numbers = f"family {told['cpu family']}, model {told['model']}"
        return f"{told['model name']} ({numbers})"
    return platform.processor() or "unknown processor"


def machine() -> str:
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        commit = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        commit = "unknown"
    return (
        f"pipedyn {pp.__version__} (commit {commit}), Python {platform.python_version()}, "
        f"numpy {np.__version__}, {platform.system()} {platform.machine()}, {processor()}, "
        f"{_core.vector_level()}"
    )


def ended() -> int:
    """Prints what failed; the exit status."""
    for failure in failures:
        print(f"FAILED {failure}")
    return 1 if failures else 0
