# SPDX-License-Identifier: MIT
"""Extension modules of SciPy, loaded without the packages around them where that is possible.

The core calls BLAS and LAPACK at the addresses that SciPy publishes for Cython. Each of them takes
5 ms to load; the package around them takes 120, because it imports most of numpy's and SciPy's own
helpers. The k-d tree takes 100 ms, and its package 100 more.
"""

import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

import scipy


@cache  # the addresses are good as long as the module is kept
def extension(package: str, name: str) -> ModuleType:
    """A module of a package of SciPy, without the package if nobody has imported that."""
    whole = f"scipy.{package}.{name}"
    if f"scipy.{package}" not in sys.modules:
        spec = PathFinder.find_spec(whole, [str(Path(scipy.__file__).parent / package)])
        if spec is not None and spec.loader is not None:
            module = module_from_spec(spec)
            with suppress(ImportError):  # where a module needs what its package prepares
                spec.loader.exec_module(module)
                sys.modules.pop(whole, None)  # it would hide the module from a later import
                return module
    return import_module(whole)
