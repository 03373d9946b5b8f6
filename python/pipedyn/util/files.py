# SPDX-License-Identifier: MIT
"""Files that are written beside their place, and take it when they are whole."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A new file beside the one at a path, to write to; at the end it takes that one's place.

    So a file is never there in part. Where writing fails, as on a full disk, or is interrupted,
    what was begun is removed, and what was there before stays as it was. The new file has its
    permissions and the ending of its name. A symbolic link stays one. What is no regular file,
    such as a pipe, is written to itself.

    Raises:
        OSError: where no file can be made in the folder, or the one that is there is protected.
    """
    place = Path(os.path.realpath(path))
    if place.exists() and not place.is_file():
        yield place
        return
    if place.exists() and not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))
    beside = place.with_name(f".{place.stem[:40]}-{os.urandom(4).hex()}{Path(path).suffix}")
    try:
        beside.open("xb").close()
    except OSError as error:
        error.filename = str(place)  # the name that the caller knows
        raise
    try:
        yield beside
        with beside.open("r+b") as file:
            os.fsync(file.fileno())  # a full disk may show here first
        if place.exists():
            shutil.copymode(place, beside)
        beside.replace(place)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
