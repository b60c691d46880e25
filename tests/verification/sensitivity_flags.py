"""How many derivatives by parameters are off, flagged and checked, against runs with 5 % more of each parameter.

    python -m tests.verification.sensitivity_flags [--seeds 1:44]

Scenes are shipped models and, of the odd seeds, random solids (``solid_strangers``) and chains of bars (``strangers``);
parameters the first friction, load, velocity and bolt force of each, modulus and density of its first material. A
change is off where it is so far from the secant of the run that ``output.check_sensitivities = "all"`` replaces it
without a flag. Precision is the share of the flagged ones that are off, recall the share of those off that are flagged.
Left are those off that have no flag and whose parameter has no run with "flagged".
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import latin_fmu
from latin_fmu.errors import LatinError
from latin_fmu.results.sensitivities import CHECKED, Sensitivities, scalars_of
from tests.scenes import MODELS

from .solid_strangers import solid
from .strangers import chain

SHIPPED = (
    "two_specimen_crushing/scene",
    "lap_joint/shock",
    "hammer_on_plate/scene",
    "shear_interface/scene",
    "bouncing_bar/scene",
)
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Pairs:
    """Pairs of quantity and parameter of a scene (n,): kind of the quantity, what holds for each, and how many of the
    parameters have a run with ``output.check_sensitivities = "flagged"``."""

    kinds: NDArray[np.str_]
    off: Mask
    flagged: Mask
    checked: Mask
    parameters: int
    runs: int

    @staticmethod
    def of(parts: Iterable[Pairs]) -> Pairs:
        """All of some scenes."""
        parts = list(parts)
        return Pairs(
            np.concatenate([p.kinds for p in parts]),
            np.concatenate([p.off for p in parts]),
            np.concatenate([p.flagged for p in parts]),
            np.concatenate([p.checked for p in parts]),
            sum(p.parameters for p in parts),
            sum(p.runs for p in parts),
        )

    @property
    def left(self) -> Mask:
        """Those off without a flag or a run."""
        return np.asarray(self.off & ~self.flagged & ~self.checked)

    def row(self, name: str) -> str:
        """A row of the table."""
        cells = [f"{mask.sum()} ({100 * mask.mean():.0f} %)" for mask in (self.off, self.flagged)]
        both = (self.off & self.flagged).sum()
        cells += [f"{both / max(mask.sum(), 1):.2f}" for mask in (self.flagged, self.off)]
        cells += [f"{self.runs} of {self.parameters}", str(self.left.sum())]
        return f"| {name} | {len(self.off)} | {' | '.join(cells)} |"


_KEYS = (
    ("contact", ("friction_coefficient",)),
    ("interface", ("friction_coefficient",)),
    ("load", ("pressure", "traction")),
    ("substructure", ("initial_velocity",)),
    ("bolt", ("force",)),
)


def parameters_of(scene: latin_fmu.Scene) -> list[str]:
    """Dotted names of the parameters of a scene (module docstring)."""
    tables, names = scene.tables(), list[str]()
    for kind, keys in _KEYS:
        values = ((f"{kind}.{n}.{key}", t.get(key)) for n, t in tables.get(kind, {}).items() for key in keys)
        numbers = (
            f"{name}.{i}" if isinstance(value, list | tuple) else name
            for name, value in values
            for i, number in enumerate(value if isinstance(value, list | tuple) else [value])
            if number
        )
        names += [name for name in [next(numbers, "")] if name]
    material = next(iter(tables["material"]))
    return [*names, f"material.{material}.young_modulus", f"material.{material}.density"]


def judged(scene: latin_fmu.Scene) -> Pairs | None:
    """The pairs of a scene; None where it has no derivatives."""
    plain = scene.replace("output.check_sensitivities", "none")
    made = latin_fmu.solve(plain.replace("output.sensitivities", parameters_of(scene))).sensitivities
    if made is None:
        return None
    runs = list[dict[str, float] | None]()
    for d in made.derivatives:
        more = latin_fmu.solve(scene.replace(d.name, (1.0 + CHECKED) * d.value))
        runs.append(scalars_of(more.outcome, more.spectra) if more.converged else None)
    return _pairs(made, runs)


def _pairs(made: Sensitivities, runs: list[dict[str, float] | None]) -> Pairs:
    none = np.zeros(len(runs), dtype=bool)
    without_flags = replace(made, quantities=[replace(q, flagged=none) for q in made.quantities])
    off = without_flags.checked(runs)
    checked = made.flagged
    rows = [
        (q.quantity.rpartition(".")[2], off.is_secant(q)[i], q.flagged[i], checked[i])
        for q in made.quantities
        for i, run in enumerate(runs)
        if run is not None and q.quantity in run
    ]
    masks = np.array([row[1:] for row in rows], dtype=bool).reshape(-1, 3)
    return Pairs(
        np.array([row[0] for row in rows]), masks[:, 0], masks[:, 1], masks[:, 2], len(runs), int(checked.sum())
    )


def scenes(first: int, end: int, folder: Path) -> Iterator[tuple[str, str, latin_fmu.Scene]]:
    """Kind, name and scene."""
    for name in SHIPPED:
        yield "shipped models", name, latin_fmu.load_scene(MODELS / f"{name}.toml")
    for seed in range(first, end):
        if seed % 2:
            yield "random solids", f"solid {seed}", solid(seed, folder)
            yield "random chains", f"chain {seed}", chain(seed).scene


def main() -> None:
    """Print a table of all scenes and of their kinds."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seeds", default="1:44", help="FIRST:END")
    first, end = map(int, parser.parse_args().seeds.split(":"))
    kinds: dict[str, list[Pairs]] = {}
    print("| scene | pairs | off | flagged | precision | recall | runs with flagged | left |\n" + "|---" * 8 + "|")  # noqa: T201
    with tempfile.TemporaryDirectory() as folder:
        for kind, name, scene in scenes(first, end, Path(folder)):
            try:
                pairs = judged(scene)
            except LatinError as error:
                print(f"{name}: {error}", file=sys.stderr)  # noqa: T201
                continue
            if pairs is None:
                print(f"{name}: no derivatives", file=sys.stderr)  # noqa: T201
                continue
            kinds.setdefault(kind, []).append(pairs)
            print(pairs.row(name), flush=True)  # noqa: T201
    for kind, parts in kinds.items():
        every = Pairs.of(parts)
        print(every.row(f"{kind}: {len(parts)}"))  # noqa: T201
        left = ", ".join(f"{n} {name}" for name, n in Counter(every.kinds[every.left].tolist()).most_common())
        print(f"| {kind}, left: {left} |" + 7 * " |")  # noqa: T201


if __name__ == "__main__":
    main()
