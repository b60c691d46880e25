"""meshlane: one library for many formats."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import meshlane

from .like_meshio import FORMATS
from .like_meshio import write as write_with
from .solid import Format, Solid

TITLE: Final = "meshlane"
REQUIRES: Final = ("meshlane==5.5.0", "h5py", "netCDF4", "lxml")
PACKAGE: Final = "meshlane"
__all__ = ["FORMATS"]


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    write_with(meshlane, solid, form, path)
