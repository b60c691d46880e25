"""Kernels of a run called from tests as plain Python, on the pools of an image; all others are called through the
entries of the library."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from latin_fmu.compiled import declare
from latin_fmu.kernels.entries import Pools
from latin_fmu.propagator.image import Image, pools_of


@contextmanager
def in_python() -> Iterator[None]:
    """Lets kernels call each other in Python."""
    with pytest.MonkeyPatch.context() as patch:
        for declared in (declare.Kernel, declare.Entry):
            patch.setattr(declared, "__call__", lambda self, *arguments: self.py_func(*arguments))
        yield


def plain_pools(image: Image) -> Pools:
    """Records and blocks of an image as kernels in Python take them."""
    image.write()
    records = (records.view(np.recarray) for records in (image.run, image.classes, image.groups))
    return pools_of(*records, image.fixed, image.moving)


def call(kernel: Any, image: Image, *arguments: Any) -> Any:
    """A kernel on the pools of an image."""
    with in_python():
        return kernel(plain_pools(image), *arguments)
