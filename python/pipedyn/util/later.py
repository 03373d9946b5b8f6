# SPDX-License-Identifier: MIT
"""scipy, imported by its first use: with what it takes along a tenth of the package's import."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import scipy as scipy
else:

    class _Later:
        def __init__(self, module: str) -> None:
            self.module = module

        def __getattr__(self, name: str) -> Any:
            found = getattr(import_module(self.module), name)
            setattr(self, name, found)  # asked for here once
            return found

    scipy = _Later("scipy")
