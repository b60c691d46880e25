"""Kernels of a run called from tests as plain Python, on the pools of an image; all others are called through the
entries of the library."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels.entries import Pools
from latin_fmu.propagator.image import Image, pools_of

_MODULES = "latin_fmu.kernels.", "latin_fmu.laws.", "latin_fmu.cholesky.substitution"


@contextmanager
def in_python() -> Iterator[None]:
    """Lets kernels call each other in Python."""
    with pytest.MonkeyPatch.context() as patch:
        for module in [m for name, m in sys.modules.items() if f"{name}.".startswith(_MODULES)]:
            for name, value in list(vars(module).items()):
                if hasattr(value, "py_func"):
                    patch.setattr(module, name, value.py_func)
        yield


def plain_pools(image: Image) -> Pools:
    """Records and blocks of an image as kernels in Python take them."""
    image.write()
    records = (records.view(np.recarray) for records in (image.run, image.classes, image.groups))
    return pools_of(*records, image.fixed, image.moving)


def plain(kernel: Any) -> Any:
    """The Python function of a kernel."""
    return getattr(kernel, "py_func", kernel)


def call(kernel: Any, image: Image, *arguments: Any) -> Any:
    """A kernel on the pools of an image."""
    with in_python():
        return plain(kernel)(plain_pools(image), *arguments)
