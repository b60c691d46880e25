"""Bolted assemblies marched body by body and by the modes of the assembly, in turn: time, memory and differences.

    python examples/benchmarks/assemblies.py [--rounds N] [--share X]

For the electronics box and the bolted beam (5 ms of it): seconds of the processor for the set-up with the static start,
for the march and for the rest, by rounds in turn, medians; the peak memory of a process of its own; and what the two
marches differ by: tensions of the bolts, work of friction, the shock response spectrum of each sensor up to 5 kHz.
``--share`` shortens the runs, to see that it works.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

MODELS = Path(__file__).resolve().parents[2] / "models"
ENDS = {"electronics_box": 10e-3, "bolted_beam": 5e-3}  # s
KINDS = ("direct", "modal")
HIGHEST, QUALITY = 5000.0, 10.0  # Hz and Q of the spectra that are compared


def one(model: str, kind: str, share: float) -> dict[str, Any]:
    """Times and results of a run."""
    import latin_fmu

    scene = latin_fmu.load_scene(MODELS / model / "scene.toml")
    scene = scene.replace("time.end", share * ENDS[model]).replace("solver.propagator", kind)
    solution = latin_fmu.solve(scene)
    outcome, timings = solution.outcome, solution.outcome.timings
    frequencies = np.geomspace(200.0, HIGHEST, 40)
    dt = float(solution.time[1] - solution.time[0])
    spectra = {
        name: latin_fmu.shock_response_spectrum(sensor.acceleration, dt, frequencies, QUALITY, interpolation="lines")
        .acceleration[0]
        .max(axis=-1)
        .tolist()
        for name, sensor in outcome.sensors.items()
        if sensor.acceleration is not None
    }
    friction = sum(float(h.friction_power.sum()) * dt for h in outcome.interfaces.values() if h.has_friction)
    return {
        "converged": outcome.converged,
        "setup": timings.setup,
        "march": timings.march,
        "rest": timings.other,
        "memory": timings.peak_memory,
        "iterations": float(np.mean([w.iterations for w in outcome.windows])),
        "bolts": {name: bolt.force.tolist() for name, bolt in outcome.bolts.items()},
        "friction": friction,
        "spectra": spectra,
    }


def apart(model: str, share: float, kind: str) -> dict[str, Any]:
    """A run in a process of its own, on one thread."""
    command = [sys.executable, __file__, "--one", model, kind, "--share", f"{share:g}"]
    made = subprocess.run(
        command, capture_output=True, text=True, check=True, env=os.environ | {"OMP_NUM_THREADS": "1"}
    )
    found: dict[str, Any] = json.loads(made.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--share", type=float, default=1.0, help="of the time of each run")
    parser.add_argument("--one", nargs=2, metavar=("MODEL", "KIND"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(*given.one, given.share)))
        return
    for model in ENDS:
        runs: dict[str, list[dict[str, Any]]] = {kind: [] for kind in KINDS}
        for _ in range(given.rounds):
            for kind in KINDS:
                runs[kind].append(apart(model, given.share, kind))
        print(f"\n{model}: {1e3 * given.share * ENDS[model]:g} ms, medians of {given.rounds}")
        for part in ("setup", "march", "rest"):
            direct, modal = (median(run[part] for run in runs[kind]) for kind in KINDS)
            print(f"  {part:6} direct {direct:8.2f} s  modal {modal:8.2f} s  direct over modal {direct / modal:.2f}")
        for kind in KINDS:
            last = runs[kind][-1]
            print(
                f"  {kind:6} {last['iterations']:.1f} iterations an instant, peak memory {last['memory'] / 1e9:.2f} GB"
                + ("" if last["converged"] else ", NOT CONVERGED")
            )
        first, second = (runs[kind][-1] for kind in KINDS)
        off = max(np.abs(np.subtract(f, second["bolts"][name])).max() for name, f in first["bolts"].items())
        print(f"  bolts differ by {off:.3g} N, work of friction {second['friction'] / first['friction'] - 1:+.2%}")
        for name, spectrum in first["spectra"].items():
            change = np.abs(np.divide(second["spectra"][name], spectrum) - 1.0)
            sizes = f"up to {change.max():.1%}, median {np.median(change):.1%}"
            print(f"  spectrum of {name} up to {HIGHEST:g} Hz differs by {sizes}")


if __name__ == "__main__":
    main()
