"""Process that uses damaged inputs: ``python -m tests.fuzz.worker SECONDS FORMAT:SEED:COUNT ...``.

Prints one JSON line for each input that ends otherwise than with a result or an error of the project: another
exception, no end after so many seconds of processor time, or anything written to the standard streams. The line
``{"at": [format, seed]}`` before each input identifies the one that a crash of the process belongs to.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from latin_fmu.errors import LatinError
from latin_fmu.mesh_files.child import NO_LIMIT

from .formats import FORMATS, Files

MEMORY = 6 << 30  # bytes of address space


class NoEndError(BaseException):
    """The time of an input is over; no ``Exception``, which readers of formats catch."""


def _over(_signal: int, _frame: Any) -> None:
    raise NoEndError


def outcome(name: str, seed: int | None, folder: Path, seconds: float) -> str:
    """What is wrong with the use of one damaged input, of whole ones without a seed; empty where nothing is."""
    attempt = FORMATS[name]
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        if seed is not None:
            attempt(np.random.default_rng([seed, sum(name.encode())]), folder)
        elif isinstance(attempt, Files):
            attempt.read_whole(folder)
    except LatinError as error:
        text = str(error)
        if seed is None:
            return text
        text.encode("utf-8")
        return f"a message of {len(text)} characters" if len(text) > 10_000 else ""
    except NoEndError:
        return f"no end after {seconds} s"
    except BaseException:
        return traceback.format_exc()[-3000:]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return ""


def main() -> None:
    """Use the inputs of the arguments one after the other."""
    report = os.fdopen(os.dup(1), "w")
    noise = tempfile.TemporaryFile()  # noqa: SIM115, to the end of the process
    for stream in (1, 2):
        os.dup2(noise.fileno(), stream)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGPROF, _over)
    warnings.simplefilter("always")
    os.environ[NO_LIMIT] = "0"  # libraries read here: a process for each of thousands of files would take hours
    sys.modules["vtkmodules.vtkCommonCore"] = None  # type: ignore[assignment]  # it crashes, which its process is for
    assert {job.partition(":")[0] for job in sys.argv[2:]} <= set(FORMATS), "no such format"
    seconds = float(sys.argv[1])
    for job in sys.argv[2:]:
        name, first, count = job.split(":")
        for seed in [None] if first == "whole" else range(int(first), int(first) + int(count)):
            report.write(json.dumps({"at": [name, seed]}) + "\n")
            report.flush()
            folder = Path(tempfile.mkdtemp())
            wrong = outcome(name, seed, folder, seconds)
            shutil.rmtree(folder)
            sys.stderr.flush()
            sys.stdout.flush()
            if size := noise.seek(0, os.SEEK_END):
                noise.seek(0)
                wrong += f"written: {noise.read(2000).decode(errors='replace')} ({size} bytes)"
                noise.truncate(0)
                noise.seek(0)
            if wrong:
                report.write(json.dumps({"wrong": [name, seed, wrong]}) + "\n")
    report.write(json.dumps({"at": None}) + "\n")
    report.flush()


if __name__ == "__main__":
    main()
