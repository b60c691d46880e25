"""Subcommand ``random``: statistics of a random vibration from independent windows, beside the linear answer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from . import (
    CONVERGED,
    NOT_CONVERGED,
    Jobs,
    Json,
    OfScene,
    Quiet,
    Scheduler,
    Signals,
    check_netcdf,
    say,
    seconds,
    tell,
    tell_written,
)
from .options import Option, command, handed

_EXAMPLES = """\
examples:
  latin-fmu random scene.toml --windows 50 -o random.nc
  latin-fmu random scene.toml --windows 200 --jobs 4 --json
  latin-fmu plot random.nc -o random.png
  latin-fmu run scene.toml --set boundary.base.law.window=7      one of the windows, with its histories

A boundary of the scene with type = "acceleration" has the law {type = "psd", file = "spec.csv"}: two columns, frequency
in Hz and density, with the unit in the header ([g^2/Hz] or [(m/s2)^2/Hz]). The run of the scene is one window; each has
another motion with this density. Windows done so far are kept in OUT.nc.points until the file is written: after an
interruption the same command continues, and one with more windows takes those that are there.

exit codes: 0 all windows converged, 1 some did not (bands are without them), 2 bad input, 130 interrupted
"""


@dataclass(frozen=True, kw_only=True)
class RandomOptions(OfScene):
    """Options of ``random``."""

    windows: Annotated[int, Option("number of windows", "N")] = 50
    startup: Annotated[
        float | None, Option("beginning of each window that does not count (default: from the damping)", "SECONDS")
    ] = None
    resolution: Annotated[
        float | None, Option("distance of the lines of the spectra (default: from the damping)", "HZ")
    ] = None
    output: Annotated[
        Path | None, Option("file of the statistics (default: <name of the scene file>_random.nc here)", "OUT.nc", "-o")
    ] = None
    jobs: Jobs = None
    scheduler: Scheduler = None
    max_cpu: Annotated[
        float | None,
        Option("limit in CPU seconds of a window; one that reaches it does not count", "SECONDS", read=seconds),
    ] = None
    json: Json = False
    quiet: Quiet = False


@command(_EXAMPLES, feeds=("random_vibration",))
def random(options: RandomOptions, signals: Signals) -> int:
    """Statistics of a random vibration with contact: rms, spectra, level crossings and peaks with their bands."""
    with signals.deferred():
        from ..machine import usable_cores
        from ..parametric.random_vibration import random_vibration
    output = options.output or Path(f"{options.scene.stem}_random.nc")
    check_netcdf(output)
    jobs = options.jobs
    if jobs is None:
        # workers of a cluster have their own cores
        jobs = usable_cores() if options.scheduler is None else 1
    log = None if options.quiet else say
    more = {"settings": options.overrides, "jobs": jobs, "log": log, "output": output}
    try:
        found = random_vibration(options.scene, **handed(options, random_vibration) | more)
    except KeyboardInterrupt:
        say(f"the windows done so far are in {output}.points: the same command continues")
        raise
    tell(options.json, found.lines(), found.report)
    if not options.quiet:
        tell_written(options.json, f"statistics: {output}")
    if found.left_out:
        return NOT_CONVERGED
    return CONVERGED
