# SPDX-License-Identifier: MIT
"""Modules imported at their first use, which saves an eighth of the time to import the package."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import difflib as difflib
    import html as html
    from concurrent import futures as futures

    import scipy as scipy
else:

    class _Later:
        def __init__(self, module: str) -> None:
            self.module = module

        def __getattr__(self, name: str) -> Any:
            found = getattr(import_module(self.module), name)
            setattr(self, name, found)  # the next use finds the attribute without this method
            return found

    difflib = _Later("difflib")
    futures = _Later("concurrent.futures")
    html = _Later("html")
    scipy = _Later("scipy")
