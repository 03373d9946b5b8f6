# SPDX-License-Identifier: MIT
"""Dynamics of a pipe conveying fluid, modelled as a chain, a reduced model or a continuous pipe.

The pipe comes with the package, and every other public name at its first use: all of them take
longer to import than numpy, and a program uses few. `__init__.pyi` says which module has a name.
"""

import re as _re
from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import Any as _Any

from pipedyn.models.pipe import Pipe as Pipe
from pipedyn.util.hints import with_hints as _with_hints

__version__ = "0.2.0"

_LISTED = _Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULES = {
    name: module for module, name in _re.findall(r"(?m)^from (\S+) import (\w+) as", _LISTED)
}

__all__ = sorted(_MODULES)

_with_hints(Pipe, "pipedyn")


def __getattr__(name: str) -> _Any:
    """A public name that is used for the first time."""
    if name not in _MODULES:
        raise AttributeError(f"module 'pipedyn' has no attribute {name!r}")
    module = _import_module(_MODULES[name])
    if module.__name__ == "pipedyn":  # the name is that of a module itself
        return _import_module(f"pipedyn.{name}")
    globals()[name] = _with_hints(getattr(module, name), "pipedyn")
    return globals()[name]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
