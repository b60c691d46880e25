"""Integrates a Model Exchange FMU with pathsim-fmi: python with_pathsim_exchange.py X.fmu END OUTPUT."""

from __future__ import annotations

import json
import sys

from pathsim import Simulation
from pathsim.solvers import RKCK54
from pathsim_fmi import ModelExchangeFMU

path, end, wanted = sys.argv[1:]
block, stop = ModelExchangeFMU(path), float(end)
simulation = Simulation(
    [block],
    [],
    dt=stop / 1000,
    dt_max=stop / 50,
    Solver=RKCK54,
    tolerance_lte_rel=1e-5,
    tolerance_lte_abs=1e-4,
    log=False,
)
simulation.run(stop)
sys.stdout.write(json.dumps([float(block.outputs[wanted]), float(block.outputs["model.events"])]) + "\n")
