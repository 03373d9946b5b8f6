# SPDX-License-Identifier: MIT
"""Progress of long sweeps: tqdm where it is installed, a line on stderr where it is not."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")


def track(items: Iterable[Item], total: int, label: str, shown: bool) -> Iterator[Item]:
    """The items, counted on stderr while they are taken."""
    if not shown:
        yield from items
        return
    try:
        from tqdm import tqdm
    except ImportError:
        for done, item in enumerate(items, start=1):
            yield item
            print(f"\r{label}: {done}/{total}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        return
    yield from tqdm(items, total=total, desc=label)
