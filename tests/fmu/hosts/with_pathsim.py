"""Runs an FMU with pathsim-fmi: python with_pathsim.py X.fmu STEP N INPUT VALUE OUTPUT [PARAMETER VALUE].

The parameter is set after N / 2 steps.
"""

from __future__ import annotations

import json
import sys

from pathsim import Connection, Simulation
from pathsim.blocks import Constant
from pathsim_fmi import CoSimulationFMU

path, step, n, given, value, wanted, *tuned = sys.argv[1:]
h = float(step)
block, source = CoSimulationFMU(path, dt=h), Constant(float(value))
simulation = Simulation([source, block], [Connection(source, block[given])], dt=h, log=False)
rows = []
for i in range(int(n)):
    if tuned and i == int(n) // 2 - 1:  # a run ends after the step that begins at its end
        block.fmu_wrapper.set_variable(tuned[0], float(tuned[1]))
    simulation.run((1 if i else 1 - 1e-6) * h, reset=False)  # the step of the FMU falls due at its start
    rows.append(float(block.outputs[wanted]))
sys.stdout.write(json.dumps(rows) + "\n")
