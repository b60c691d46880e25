"""Cost of contact against the number of points of a face: two plates of m x m x h elements with friction.

    python examples/benchmarks/large_faces.py [--quick] [-o FOLDER] [--dense] [--landing | --long]

Aluminium on steel, elements of 1 mm, mu = 0.3, steps of 0.15 us (a wave passes 0.95 element), a half sine of pressure
on top. Printed for every case, CPU time of one thread and peak memory of a process of its own:

    set-up    both bodies, factors, diagonal of the compliance, tables, without the assembly of the matrices, seconds
    march     milliseconds per instant, and over those of the same plates without contact between them
    defect    largest residual of the laws that the truncation of the tables leaves at an instant (tolerance 1e-3)
    growth    exponent p in points^p from the case before

By sparse tables and exactly; with ``--dense`` also with dense matrices of the interfaces. Figure: cost against points.
With ``--landing`` the march of plates that close a gap of 2 um, by the scheme for bodies that land (generalized_alpha)
over that by hht, in turn in one process, and nothing else. With ``--long`` ten instants in steps of 10 and 100 us with
friction 0.6 and 0.1, over the instants without contact, and nothing else: the sides slip, and Newton steps are made.
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
from latin_fmu.building import discretise, solver_ready, started
from latin_fmu.latin.outcome import Outcome, Timings
from latin_fmu.machine import one_thread
from latin_fmu.march import march as march_problem
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, Description, column, half_sine

CASES = ((24, 2), (40, 2), (70, 2), (40, 6))
QUICK = ((8, 2), (12, 2))
INSTANTS = 60
ROUNDS = 2
SCHEMES = ("hht", "generalized_alpha")
GAP = 2e-6  # m, of plates that land
LONG = tuple((step, friction) for step in (1e-5, 1e-4) for friction in (0.6, 0.1))  # s


@dataclass(frozen=True)
class Motion:
    """Steps (s) and their number, duration of the pulse (s), friction, gap (m) and time scheme of a march."""

    step: float = 1.5e-7
    instants: int = INSTANTS
    pulse: float = 1e-5
    friction: float = 0.3
    gap: float = 0.0
    scheme: str = SCHEMES[0]


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


def plates(m: int, h: int, form: str, contact: bool = True, motion: Motion = Motion()) -> latin_fmu.Scene:
    """Two plates of m x m x h elements; without ``contact`` they do not meet, and both are loaded."""
    size, elements = (1e-3 * m, 1e-3 * m, 1e-3 * h), (m, m, h)
    tables: Description = column(
        {"lower": Box(ALUMINIUM, size, elements), "upper": Box(STEEL, size, elements)},
        {"crush": {"friction_coefficient": motion.friction, "gap": motion.gap}},
        {"end": motion.step * motion.instants, "step": motion.step, "scheme": motion.scheme},
        load={"press": {"face": "upper.zmax", "pressure": 2e8, "law": half_sine(motion.pulse)}},
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
        problem = solver_ready(*started(ready, {}))
    return march_problem(problem, timings=Timings(setup=time.process_time() - begin)).outcome


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
            outcome = solved(plates(m, h, form, motion=Motion(scheme=scheme, gap=GAP)))
            own.append(outcome.timings.march / INSTANTS)
            passes[scheme] = float(np.mean([w.iterations for w in outcome.windows]))
    hht, other = (min(own) for own in marches.values())
    numbers = "".join(f"{1e3 * min(marches[scheme]):9.2f} {passes[scheme]:5.2f}" for scheme in SCHEMES)
    return f"{f'{m} x {m} x {h} {form}':>20} {(m + 1) ** 2:6d} {numbers} {other / hht:6.2f}"


def long_steps(m: int, h: int) -> None:
    """Print lines on marches in long steps over the instants without contact: the better of ``ROUNDS``, in turn."""
    for step, friction in LONG:
        motion = Motion(step, 10, 10 * step / 1.5, friction)
        runs: dict[bool, list[Outcome]] = {True: [], False: []}
        for _ in range(ROUNDS):
            for contact, own in runs.items():
                own.append(solved(plates(m, h, "automatic", contact, motion)))
        march, free = (1e3 * min(o.timings.march for o in runs[c]) / motion.instants for c in (True, False))
        windows = runs[True][0].windows
        iterations, steps = (float(np.mean([getattr(w, n) for w in windows])) for n in ("iterations", "newton_steps"))
        peak = 1024e-9 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(
            f"{f'{m} x {m} x {h}':>14} {(m + 1) ** 2:6d} {1e6 * step:6.0f} {friction:5.2f} {march:8.1f} {free:7.1f} "
            f"{march / free:6.1f} {iterations:6.1f} {steps:6.1f} {all(w.converged for w in windows)!s:>9} {peak:7.2f}",
            flush=True,
        )


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
    chosen = tools.options([a for a in arguments if a not in ("--dense", "--landing", "--long")], __doc__)
    cases = QUICK if chosen.quick else CASES
    forms = ("sparse", "exact", "dense") if "--dense" in arguments else ("sparse", "exact")
    if "--long" in arguments:
        print(f"{'case':>14} points   us    mu  ms/inst    free  ratio   iter  steps converged peak GB")
        for m, h in QUICK[:1] if chosen.quick else ((40, 2),):
            long_steps(m, h)
        return {}
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
