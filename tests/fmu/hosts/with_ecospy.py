"""Runs an FMU with ecospy: python with_ecospy.py X.fmu STEP N INPUT VALUE OUTPUT [PARAMETER VALUE].

The parameter is set after N / 2 steps.
"""

from __future__ import annotations

import json
import sys

from ecospy import EcosSimulation, EcosSimulationStructure

path, step, n, given, value, wanted, *tuned = sys.argv[1:]
with EcosSimulationStructure() as structure:
    structure.add_model("one", path)
    with EcosSimulation(float(step), structure=structure) as simulation:
        simulation.init()
        simulation.set_real(f"one::{given}", float(value))
        rows = []
        for i in range(int(n)):
            if tuned and i == int(n) // 2:
                simulation.set_real(f"one::{tuned[0]}", float(tuned[1]))
            simulation.step(1)
            rows.append(simulation.get_real(f"one::{wanted}"))
        simulation.terminate()
sys.stdout.write(json.dumps(rows) + "\n")
