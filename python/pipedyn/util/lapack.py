# SPDX-License-Identifier: MIT
"""BLAS and LAPACK of SciPy, which the core calls at the addresses that SciPy publishes for Cython.

Both are extension modules in the folder of `scipy.linalg`. They take 5 ms to load; the package
around them takes 120, because it imports most of numpy's and SciPy's own helpers.
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
def library(name: str) -> ModuleType:
    """SciPy's "cython_blas" or "cython_lapack", without the package if nobody has imported that."""
    whole = f"scipy.linalg.{name}"
    if "scipy.linalg" not in sys.modules:
        spec = PathFinder.find_spec(whole, [str(Path(scipy.__file__).parent / "linalg")])
        if spec is not None and spec.loader is not None:
            module = module_from_spec(spec)
            with suppress(ImportError):  # where a module needs what its package prepares
                spec.loader.exec_module(module)
                sys.modules.pop(whole, None)  # it would hide the module from a later import
                return module
    return import_module(whole)
