"""CalculiX (ccx): a run of the deck of a scene (``latin_fmu.decks.exporting``), and what it prints.

Same mesh, materials, conditions, loads, steps; dynamics by the Hilber-Hughes-Taylor scheme of the scene, or statics;
interfaces as face-to-face penalty contact with Coulomb friction, or bonded by merging their nodes.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from latin_fmu.assembly.problem import DiscretisedProblem

Array = NDArray[np.float64]


def shared_nodes(ready: DiscretisedProblem) -> dict[str, NDArray[np.int64]]:
    """Numbers of the nodes of each body, from 1, for ``export_deck``: nodes that coincide are one, so that interfaces
    are bonded."""
    bodies = ready.bodies
    points = np.concatenate([body.mesh.nodes for body in bodies.values()])
    size = float(np.ptp(points, axis=0).max())
    number = 1 + np.unique(np.round(points / size, 9) + 0.0, axis=0, return_inverse=True)[1].ravel()
    parts = np.split(number, np.cumsum([body.mesh.n_node for body in bodies.values()])[:-1])
    return dict(zip(bodies, parts, strict=True))


# -- run --------------------------------------------------------------------------------------------------------------
MISSING = "CalculiX (ccx) is not installed: Debian and Ubuntu have it as calculix-ccx; nothing is compared with it"
_TIME = re.compile(r"time\s+([-+.\dEe]+)\s*$")
_LONG = re.compile(r"(\.\d+)([+-]\d{3})\b")  # an exponent of three digits pushes its E out
_PAIR = re.compile(r"slave set (\w+), master set (\w+) and time")


@dataclass(frozen=True)
class Printed:
    """What a run left in its .dat file.

    Attributes
    ----------
    time : instants printed, s. displacement : (n_time, n_node, 3) by number of the node from 1, m, or None.
    force : total force on the slave surface (n_time, 3), N, by (slave, master). held : forces on the nodes that print
        them (n_time, n_node, 3), by number from 1, N, or None.
    """

    time: Array
    displacement: Array | None
    force: dict[tuple[str, str], Array]
    held: Array | None = None


@dataclass(frozen=True)
class Finished:
    """A run of ccx: CPU seconds, increments and iterations, and what it printed; ``complete``: reached the end. text :
    of the .dat file."""

    seconds: float
    increments: int
    iterations: int
    complete: bool
    printed: Printed
    stress: Array | None = None
    text: str = ""


def installed() -> bool:
    """Whether there is a ccx to run."""
    return shutil.which("ccx") is not None


def run(deck: str, end: float, limit: float = 600.0) -> Finished:
    """Run ccx on one thread, at most ``limit`` seconds of wall clock; ``end`` is the last instant, s."""
    with TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "deck.inp").write_text(deck)
        one = {**os.environ, "OMP_NUM_THREADS": "1", "CCX_NPROC_RESULTS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"}
        before = os.times()
        with (place / "log").open("w") as log, suppress(subprocess.TimeoutExpired):
            subprocess.run(["ccx", "-i", "deck"], cwd=place, env=one, stdout=log, stderr=log, timeout=limit)
        after = os.times()
        seconds = after.children_user + after.children_system - before.children_user - before.children_system
        data = place / "deck.dat"
        text = data.read_text() if data.exists() else ""
        printed = read(text)
        counts = _steps(place / "deck.sta")
        fields = place / "deck.frd"
        stress = stress_of(fields.read_text()) if fields.exists() else None
    complete = bool(len(printed.time)) and printed.time[-1] >= end * (1.0 - 1e-6)
    return Finished(seconds, len(counts), sum(counts), complete, printed, stress, text)


def _steps(path: Path) -> list[int]:
    """Iterations of every increment that was accepted."""
    if not path.exists():
        return []
    rows = [line.split() for line in path.read_text().splitlines()]
    return [int(r[3]) for r in rows if len(r) == 7 and r[0].isdigit()]


def read(text: str) -> Printed:
    """Contents of a .dat file."""
    moved: dict[float, Array] = {}
    held: dict[float, Array] = {}
    forces: dict[tuple[str, str], dict[float, Array]] = {}
    for title, body in _blocks(text):
        found = _TIME.search(title)
        if found is None:
            continue
        time = float(found.group(1))
        pair = _PAIR.search(title)
        kind = title.split()[0]
        if kind in ("displacements", "forces"):
            rows = np.array([_numbers(line) for line in body])
            field = np.zeros((int(rows[:, 0].max()), 3))
            field[rows[:, 0].astype(int) - 1] = rows[:, 1:]
            (moved if kind == "displacements" else held)[time] = field
        elif pair is not None:
            numbers = next(line for line in body if not line.lstrip().startswith("total"))
            forces.setdefault((pair[1], pair[2]), {})[time] = np.array([float(x) for x in numbers.split()[:3]])
    times = sorted(moved or held or next(iter(forces.values()), {}))
    return Printed(
        np.array(times),
        np.stack([moved[t] for t in times]) if moved else None,
        {pair: np.stack([found[t] for t in times]) for pair, found in forces.items()},
        np.stack([held[t] for t in times]) if held else None,
    )


def stress_of(text: str) -> Array | None:
    """Stresses (n_node, 6) at the nodes by number from 1, xx yy zz yz xz xy, of the last instant in a .frd file; None
    where it has none. A row has a key of 3 characters, a number of 10, and six values of 12."""
    blocks = text.split(" -4  STRESS")[1:]
    if not blocks:
        return None
    rows = [line for line in blocks[-1].split("\n -3")[0].splitlines() if line.startswith(" -1")]
    numbers = np.array([int(line[3:13]) for line in rows])
    values = np.array([[float(line[k : k + 12]) for k in range(13, 85, 12)] for line in rows])
    stress = np.full((numbers.max(), 6), np.nan)
    stress[numbers - 1] = values[:, [0, 1, 2, 4, 5, 3]]  # there xx yy zz xy yz zx
    return stress


def _numbers(line: str) -> list[float]:
    return [float(x) for x in _LONG.sub(r"\1E\2", line).split()]


def _blocks(text: str) -> Iterator[tuple[str, list[str]]]:
    """Title and lines of every block; the title is the line with the time."""
    title, body = "", []
    for line in text.splitlines():
        if not line.strip():
            continue
        if _TIME.search(line):
            if title:
                yield title, body
            title, body = line, []
        else:
            body.append(line)
    if title:
        yield title, body
