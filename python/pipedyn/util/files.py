# SPDX-License-Identifier: MIT
"""Writing of files so that an existing file is replaced only by a complete new one."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Gives a new file to write to in a `with` block, which afterwards replaces the file at `path`.

    No file is ever left half written. If writing fails, as on a full disk, or is interrupted, the
    new file is removed and the old one stays as it was. The new file lies in the same folder, and
    has the extension and the permissions of the old one. A symbolic link at `path` stays a link. If
    the file at `path` exists and is no regular file, e.g. a named pipe, it is written to directly.

    Raises:
        OSError: if no file can be made in the folder, or the existing one is write-protected.
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
        error.filename = str(place)  # the caller does not know the name of the new file
        raise
    try:
        yield beside
        with beside.open("r+b") as file:
            os.fsync(file.fileno())  # a full disk may raise its error only here
        if place.exists():
            shutil.copymode(place, beside)
        beside.replace(place)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
