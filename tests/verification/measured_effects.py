"""The table of effects of ``explain --run`` tested: the price of every switch by runs of another process, its influence
by runs on a mesh 1.5 times as fine, with 1.5 times as many steps.

    python -m tests.verification.measured_effects two_specimen_crushing hammer_on_plate stacked_blocks/n04 gripped_bar

A price holds where the CPU time of the changed run over that of the scene is within 15 % of that in the table. An
influence holds where it is within a factor two; influences below a thousandth count as a thousandth.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import latin_fmu
from latin_fmu.accuracy.measured_effects import MeasuredEffects, changes, measured_effects
from latin_fmu.accuracy.runs import Resolution, at_resolution, mesh_factor, mesh_files
from latin_fmu.effects.explanation import explain
from latin_fmu.scene.quantity_table import FLOOR
from tests.scenes import MODELS

PRICE, INFLUENCE, FINER = 0.15, 2.0, 1.5
SHORT = 1.5  # s of pairs of runs that settle a price


@dataclass(frozen=True)
class Judged:
    """A switch of a scene: its cost over that of the scene, in the table and measured again; the change of the results
    likewise, by kind."""

    scene: str
    effect: str
    cost: tuple[float, float]
    changes: dict[str, tuple[float, float]]

    @property
    def priced(self) -> bool:
        return abs(self.cost[0] / self.cost[1] - 1.0) <= PRICE

    def influences(self) -> Iterator[bool]:
        """Whether each change is within the factor."""
        for told, true in self.changes.values():
            told, true = max(told, FLOOR), max(true, FLOOR)
            yield max(told / true, true / told) <= INFLUENCE

    def line(self) -> str:
        """A row of the table."""
        told, measured = self.cost
        cells = [f"{self.scene:22s} {self.effect:30s} {told:6.2f} {measured:6.2f} {'' if self.priced else '!':1s}"]
        for (kind, (told, true)), holds in zip(self.changes.items(), self.influences(), strict=True):
            cells.append(f"{kind} {100 * told:.2g}, {100 * true:.2g} %{'' if holds else ' !'}")
        return "  ".join(cells)


def cost(pair: tuple[latin_fmu.Scene, latin_fmu.Scene]) -> float:
    """CPU time of the second scene over that of the first, the least of several runs in turn."""
    times: tuple[list[float], list[float]] = ([], [])
    while len(times[1]) < 2 or (len(times[1]) < 8 and sum(map(sum, times)) < SHORT):
        for scene, own in zip(pair, times, strict=True):
            start = time.process_time()
            _ = latin_fmu.solve(scene).spectra
            own.append(time.process_time() - start)
    return min(times[1]) / min(times[0])


def finer(scene: latin_fmu.Scene) -> latin_fmu.Scene:
    """A scene on a finer mesh and with more steps; a mesh from a file stays."""
    mesh = 1.0 if mesh_files(scene) else mesh_factor(scene, FINER)
    return at_resolution(scene, Resolution(mesh, 1.0 if scene.time.quasi_static else FINER))


def judged(name: str) -> Iterator[Judged]:
    """The switches of a shipped scene."""
    folder, _, file = name.partition("/")
    scene = latin_fmu.load_scene(MODELS / folder / f"{file or 'scene'}.toml")
    found: MeasuredEffects = measured_effects(scene, [s.settings for s in explain(scene).suggestions if s.settings])
    sys.stderr.write(f"{name}\n{found.text()}\n")
    plain = latin_fmu.solve(finer(scene))
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        pool.submit(cost, (scene, scene)).result()  # loads kernels
        for row in found.effects:
            if not row.times:
                continue
            measured = pool.submit(cost, (scene, row.scene)).result()
            other = latin_fmu.solve(finer(row.scene))
            true = changes(finer(scene), plain, other) if other.converged else {}
            both = {kind: (told, true[kind]) for kind, told in row.changes.items() if kind in true}
            yield Judged(name, row.effect, (row.cpu / found.plain.cpu, measured), both)


def main() -> None:
    """Print every switch with costs and changes, of the table and again (``!``: beyond the limit), and the sums."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("models", nargs="+", help="MODEL or MODEL/FILE below models/")
    rows = [row for name in parser.parse_args().models for row in judged(name)]
    print("scene                  without                        cost listed, again   changes listed, again")  # noqa: T201
    print("\n".join(row.line() for row in rows))  # noqa: T201
    held = [holds for row in rows for holds in row.influences()]
    priced = sum(row.priced for row in rows)
    print(  # noqa: T201
        f"price within {100 * PRICE:g} %: {priced} of {len(rows)}; influence within {INFLUENCE:g}: "
        f"{sum(held)} of {len(held)}"
    )


if __name__ == "__main__":
    main()
