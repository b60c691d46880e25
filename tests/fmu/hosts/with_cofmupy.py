"""Runs an FMU with cofmupy: python with_cofmupy.py X.fmu STEP N INPUT VALUE OUTPUT."""

from __future__ import annotations

import json
import sys

from cofmupy import Coordinator

path, step, n, given, value, wanted = sys.argv[1:]
fmu = {"id": "one", "name": "one", "path": path, "initialization": {given: float(value)}}
plan = {"fmus": [fmu], "connections": [], "cosim_method": "jacobi", "edge_sep": " -> ", "root": ""}
coordinator = Coordinator()
coordinator.start(plan)
rows = []
for _ in range(int(n)):
    coordinator.do_step(float(step))
    rows.append(float(coordinator.get_variable(("one", wanted))[0]))
sys.stdout.write(json.dumps(rows) + "\n")
