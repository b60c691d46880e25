"""Runs an FMU with libcosimpy (FMI 2): python with_libcosimpy.py X.fmu STEP N INPUT VALUE OUTPUT [PARAMETER VALUE].

The parameter is set after N / 2 steps.
"""

from __future__ import annotations

import json
import sys

from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

path, step, n, given, value, wanted, *tuned = sys.argv[1:]
execution = CosimExecution.from_step_size(round(float(step) * 1e9))  # nanoseconds
slave = execution.add_local_slave(CosimLocalSlave(path, "one"))
manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
execution.add_manipulator(manipulator)
execution.add_observer(observer)
references = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
manipulator.slave_real_values(slave, [references[given]], [float(value)])
rows = []
for i in range(int(n)):
    if tuned and i == int(n) // 2:
        manipulator.slave_real_values(slave, [references[tuned[0]]], [float(tuned[1])])
    assert execution.step()
    rows.append(observer.last_real_values(slave, [references[wanted]])[0])
sys.stdout.write(json.dumps(rows) + "\n")
