"""Cost of contact against the number of points of a face: two plates of m x m x h elements with friction.

    python examples/benchmarks/large_faces.py [--quick] [-o FOLDER] [--dense] [--landing]

Aluminium on steel, elements of 1 mm, mu = 0.3, steps of 0.15 us (a wave passes 0.95 element), a half sine of pressure
on top. Printed for every case, CPU time of one thread and peak memory of a process of its own:

    set-up    both bodies, factors, diagonal of the compliance, tables, without the assembly of the matrices, seconds
    march     milliseconds per instant, and over those of the same plates without contact between them
    defect    largest residual of the laws that the truncation of the tables leaves at an instant (tolerance 1e-3)
    growth    exponent p in points^p from the case before

By sparse tables and exactly; with ``--dense`` also with dense matrices of the interfaces. Figure: cost against points.
With ``--landing`` the march of plates that close a gap of 2 um, by the scheme for bodies that land (generalized_alpha)
over that by hht, in turn in one process, and nothing else.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from harness import tools
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import latin_fmu
from latin_fmu.api import run
from latin_fmu.assembly.build import discretise, solver_ready
from latin_fmu.latin.outcome import Outcome, Timings
from latin_fmu.machine import one_thread
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, Description, column, half_sine

CASES = ((24, 2), (40, 2), (70, 2), (40, 6))
QUICK = ((8, 2), (12, 2))
INSTANTS = 60
ROUNDS = 2
SCHEMES = ("hht", "generalized_alpha")
GAP = 2e-6  # m, of plates that land


@dataclass(frozen=True)
class Cost:
    """Cost of a case: points of the face, unknowns, set-up (s), march and contact-free march (s per instant),
    iterations per instant, largest defect, peak memory (bytes)."""

    points: int
    unknowns: int
    set_up: float
    march: float
    free: float
    iterations: float
    defect: float
    peak: int

    @property
    def ratio(self) -> float:
        """March over contact-free march."""
        return self.march / self.free


def plates(
    m: int, h: int, form: str, contact: bool = True, scheme: str = SCHEMES[0], gap: float = 0.0
) -> latin_fmu.Scene:
    """Two plates of m x m x h elements; without ``contact`` they do not meet, and both are loaded."""
    size, elements = (1e-3 * m, 1e-3 * m, 1e-3 * h), (m, m, h)
    tables: Description = column(
        {"lower": Box(ALUMINIUM, size, elements), "upper": Box(STEEL, size, elements)},
        {"crush": {"friction_coefficient": 0.3, "gap": gap}},
        {"end": 1.5e-7 * INSTANTS, "step": 1.5e-7, "scheme": scheme},
        load={"press": {"face": "upper.zmax", "pressure": 2e8, "law": half_sine(1e-5)}},
        solver={"share_identical": False, "interface_operator": form},
        output={"fields": False},
    )
    tables["boundary"] = {"base": {"type": "symmetry", "face": "lower.zmin"}}
    for side in ("xmin", "ymin"):
        tables["boundary"] |= {f"{b}_{side}": {"type": "symmetry", "face": f"{b}.{side}"} for b in ("lower", "upper")}
    if not contact:
        del tables["interface"]
        tables["load"]["below"] = {**tables["load"]["press"], "face": "lower.zmax"}  # a plate at rest costs nothing
    return latin_fmu.scene_from_dict(tables)


def solved(scene: latin_fmu.Scene) -> Outcome:
    """Run of a scene; the assembly of its matrices is not in the set-up."""
    with one_thread():
        ready = discretise(scene)
        begin = time.process_time()
        problem = solver_ready(ready, {})
    return run(problem, Timings(setup=time.process_time() - begin))


def measured(m: int, h: int, form: str) -> Cost:
    """Cost of one case in this process: the better of ``ROUNDS`` marches with contact and without, in turn."""
    runs: dict[bool, list[Outcome]] = {True: [], False: []}
    peak = 0
    for _ in range(ROUNDS):
        for contact in (True, False):
            runs[contact].append(solved(plates(m, h, form, contact)))
            peak = peak or 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    march, free = (min(s.timings.march for s in runs[contact]) / INSTANTS for contact in (True, False))
    solution = runs[True][0]
    return Cost(
        (m + 1) ** 2,
        6 * (m + 1) ** 2 * (h + 1),
        min(s.timings.setup for s in runs[True]),
        march,
        free,
        float(np.mean([w.iterations for w in solution.windows])),
        max(w.defect for w in solution.windows),
        peak,
    )


def in_a_process(m: int, h: int, form: str) -> Cost:
    """The same in a process of its own, of one thread."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--case", str(m), str(h), form]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return Cost(**json.loads(done.stdout.splitlines()[-1]))


def landing(m: int, h: int, form: str) -> str:
    """Line on the march of plates that land by both schemes, the better of ``ROUNDS``, in turn."""
    marches: dict[str, list[float]] = {scheme: [] for scheme in SCHEMES}
    passes: dict[str, float] = {}
    for _ in range(ROUNDS):
        for scheme, own in marches.items():
            outcome = solved(plates(m, h, form, scheme=scheme, gap=GAP))
            own.append(outcome.timings.march / INSTANTS)
            passes[scheme] = float(np.mean([w.iterations for w in outcome.windows]))
    hht, other = (min(own) for own in marches.values())
    numbers = "".join(f"{1e3 * min(marches[scheme]):9.2f} {passes[scheme]:5.2f}" for scheme in SCHEMES)
    return f"{f'{m} x {m} x {h} {form}':>20} {(m + 1) ** 2:6d} {numbers} {other / hht:6.2f}"


def line(cost: Cost, name: str, before: Cost | None) -> str:
    """A line of the table."""
    growth = ""
    if before is not None and before.points < cost.points:
        grown = np.log(cost.points / before.points)
        exponents = [np.log(a / b) / grown for a, b in ((cost.set_up, before.set_up), (cost.march, before.march))]
        growth = "  ".join(f"{p:4.2f}" for p in exponents)
    return (
        f"{name:>20} {cost.points:6d} {cost.unknowns:8d} {cost.set_up:7.2f} {1e3 * cost.march:8.2f} "
        f"{1e3 * cost.free:8.2f} {cost.ratio:6.2f} {cost.iterations:5.2f} {cost.defect:8.1e} "
        f"{cost.peak / 1e6:7.0f}  {growth}"
    )


def drawn(costs: dict[str, list[Cost]]) -> Figure:
    """Figure of the cost against points."""
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    march, set_up = figure.subplots(1, 2)
    for (form, own), colour in zip(costs.items(), (tools.BLUE, tools.VERMILION, tools.GREEN), strict=False):
        points = [c.points for c in own]
        march.loglog(points, [1e3 * c.march for c in own], "o-", color=colour, label=form)
        set_up.loglog(points, [c.set_up for c in own], "o-", color=colour, label=form)
    first = next(iter(costs.values()))
    march.loglog([c.points for c in first], [1e3 * c.free for c in first], "k:", label="without contact")
    for axis, label in ((march, "CPU ms per instant"), (set_up, "CPU s of the set-up")):
        axis.set_xticks([c.points for c in first], [f"{c.points:,}" for c in first])
        axis.xaxis.set_minor_formatter(NullFormatter())
        tools.label_few(axis)
        axis.set_xlabel("points of the face")
        axis.set_ylabel(label)
        tools.tidy(axis)
    march.legend(frameon=False)
    return figure


def main(argv: list[str] | None = None) -> dict[str, list[Cost]]:
    """Print the table and draw the figure; the costs of the thin plates by form."""
    arguments = sys.argv[1:] if argv is None else argv
    if arguments[:1] == ["--case"]:
        print(json.dumps(asdict(measured(int(arguments[1]), int(arguments[2]), arguments[3]))))
        return {}
    chosen = tools.options([a for a in arguments if a not in ("--dense", "--landing")], __doc__)
    cases = QUICK if chosen.quick else CASES
    forms = ("sparse", "exact", "dense") if "--dense" in arguments else ("sparse", "exact")
    if "--landing" in arguments:
        print(f"{'case':>20} points  hht, ms  iter landing, ms iter  ratio")
        for form in forms:
            for m, h in cases:
                print(landing(m, h, form), flush=True)
        return {}
    print(
        f"{'case':>20} points unknowns  set-up  ms/inst     free  ratio  iter   defect peak MB  growth of set-up, march"
    )
    costs: dict[str, list[Cost]] = {form: [] for form in forms}
    for form in forms:
        for m, h in cases:
            own = costs[form]
            cost = in_a_process(m, h, form)
            print(line(cost, f"{m} x {m} x {h} {form}", own[-1] if own and h == 2 else None), flush=True)
            if h == 2:
                own.append(cost)
    tools.save(drawn(costs), Path(chosen.folder), "large_faces")
    return costs


if __name__ == "__main__":
    main()
