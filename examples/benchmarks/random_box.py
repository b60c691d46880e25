"""Windows of a random vibration of the electronics box beside a run of its own, and beside a direct transient.

    python examples/benchmarks/random_box.py [--end S] [--windows N] [--lowest HZ] [--level L]

The shock of the model is replaced by a base acceleration of a flat density L g^2/Hz from the lowest frequency to 2 kHz.
CPU seconds of one thread: of a run of the scene by itself; of the first window, which makes the set-up, and of those
that follow, statistics of their signals included; and of a linear transient of the merged mesh of equal length and step
with all joints bonded, HHT with one solution by a factor and one product with K and with M in a step
(``assemblies.py``).
Windows of 10 ms say what an instant costs; statistics take longer ones (``latin-fmu random`` says how long).
"""

from __future__ import annotations

import argparse
from statistics import median
from time import process_time

from assemblies import MODELS, bonded_scene, transient

import latin_fmu
from latin_fmu.parametric.point import Grid, Parameter, Plan, PointSolver
from latin_fmu.parametric.study import tables_of
from latin_fmu.parametric.window_statistics import WindowEvaluation

MANY = 200


def main() -> None:
    """Print times and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--end", type=float, default=10e-3, help="of a window, s")
    parser.add_argument("--windows", type=int, default=6, help="that are measured")
    parser.add_argument("--lowest", type=float, default=500.0, help="frequency, Hz")
    parser.add_argument("--level", type=float, default=0.15, help="density, g^2/Hz")
    options = parser.parse_args()
    density = options.level * 9.80665**2
    law = f'{{type = "psd", frequency = [{options.lowest}, 2000.0], density = [{density}, {density}]}}'
    settings = [f"boundary.base.law={law}", "boundary.base.value=[0,0,1.0]", f"time.end={options.end}"]
    settings += ["output.energy=false"]
    file = MODELS / "electronics_box" / "scene.toml"
    begin = process_time()
    alone = latin_fmu.solve(latin_fmu.load_scene(file, settings))
    lone = process_time() - begin
    tables, folder = tables_of(file, settings)
    grid = Grid(tables, folder, (Parameter("boundary.base.law.window", tuple(range(options.windows))),), True)
    solver = PointSolver(Plan(grid, evaluation=WindowEvaluation(0.5 * options.end, 200, 4000.0)))
    records = [solver.solve((i,)) for i in range(options.windows)]
    first, later = records[0]["cpu"], median(record["cpu"] for record in records[1:])
    linear = transient(bonded_scene(1.0).replace("time.end", options.end))["march"]
    print(f"windows of {1e3 * options.end:g} ms, {options.lowest:g} to 2000 Hz, {options.level:g} g^2/Hz")
    for record in records:
        print(f"  {record['cpu']:8.2f} s  {record['message']}")
    timings = alone.timings
    print(
        f"a run by itself {lone:.1f} s: set-up {timings.setup:.1f}, march {timings.march:.1f}, rest {timings.other:.1f}"
    )
    print(f"a window {later:.2f} s, {later / lone:.2f} of a run by itself; the first one {first:.1f} s")
    whole = first + (MANY - 1) * later
    print(f"direct transient {linear:.1f} s; {MANY} windows {whole:.0f} s, {whole / linear:.1f} of it")


if __name__ == "__main__":
    main()
