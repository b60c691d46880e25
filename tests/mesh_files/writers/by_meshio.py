"""meshio: one library for many formats."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import meshio

from .like_meshio import FORMATS
from .like_meshio import write as write_with
from .solid import Format, Solid

TITLE: Final = "meshio"
REQUIRES: Final = ("meshio==5.3.5", "h5py", "netCDF4", "lxml")
PACKAGE: Final = "meshio"
__all__ = ["FORMATS"]


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    write_with(meshio, solid, form, path)
