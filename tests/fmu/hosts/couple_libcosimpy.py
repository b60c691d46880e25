"""Couples two FMUs with libcosimpy (FMI 2): python couple_libcosimpy.py A.fmu B.fmu STEP N SENT TAKEN WANTED.

The output SENT of each goes to the input TAKEN of the other; prints the output WANTED of the first after each step.
"""

from __future__ import annotations

import json
import sys

from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

first, second, step, n, sent, taken, wanted = sys.argv[1:]
execution = CosimExecution.from_step_size(round(float(step) * 1e9))  # nanoseconds
slaves = [execution.add_local_slave(CosimLocalSlave(path, name)) for path, name in ((first, "a"), (second, "b"))]
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
references = [{v.name.decode(): v.reference for v in execution.slave_variables(slave)} for slave in slaves]
for own, other in ((0, 1), (1, 0)):
    ends = slaves[own], references[own][sent], slaves[other], references[other][taken]
    assert execution.connect_real_variables(*ends) == 0
rows = []
for _ in range(int(n)):
    assert execution.step()
    rows.append(observer.last_real_values(slaves[0], [references[0][wanted]])[0])
sys.stdout.write(json.dumps(rows) + "\n")
