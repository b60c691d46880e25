"""Which programs made a result, and when."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from functools import cache
from importlib import metadata

PAPER = (
    "P. Ladeveze, H. Lemoussu, P.A. Boucard, A modular approach to 3-D impact computation with frictional "
    "contact, Computers and Structures 78 (2000) 45-51"
)


def package_version() -> str:
    """Version of this package."""
    from .. import __version__  # not at the top: the package imports this module before it knows its version

    return __version__


def provenance() -> dict[str, str]:
    """Versions, source and time of creation, ready to be root attributes of a results file."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    version = package_version()
    return {
        "source": f"latin_fmu {version}: LATIN method",
        "history": f"{now} computed by latin_fmu {version}",
        "references": PAPER,
        "latin_fmu_version": version,
        "python_version": platform.python_version(),
        **_libraries(),
    }


@cache
def _libraries() -> dict[str, str]:
    """Versions of the libraries, read from their metadata once (a millisecond each: as much as a small run)."""
    return {f"{name}_version": metadata.version(name) for name in ("numpy", "scipy", "xarray")}
