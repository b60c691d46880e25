"""Runs an FMU with OMSimulator 3 (FMI 2): python with_omsimulator.py X.fmu STEP N INPUT VALUE OUTPUT [PARAMETER VALUE].

The parameter is set after N / 2 steps. Of an SSP, X.ssp, names begin with that of a component; its step is used.
"""

from __future__ import annotations

import json
import sys

from OMSimulator import OMSimulator


def done(status: int, what: str) -> None:
    """Status 0, or 1 with a warning."""
    if status > 1:
        sys.exit(f"{what}: status {status}")


path, step, n, given, value, wanted, *tuned = sys.argv[1:]
h, host = float(step), OMSimulator()
done(host.setLogFile("omsimulator.log"), "log")  # its messages are printed otherwise
done(host.setTempDirectory("omsimulator"), "folder")
if path.endswith(".ssp"):
    model, status = host.importFile(path)
    one = f"{model}.{model}"
else:
    model, one = "model", "model.root.one"
    done(host.newModel(model), "model")
    done(host.addSystem("model.root", host.system_wc), "system")
    status = host.addSubModel(one, path)
done(status, path)
done(host.setStopTime(model, int(n) * h), "stop")
if not path.endswith(".ssp"):
    done(host.setFixedStepSize("model.root", h), "step")
done(host.setTolerance(model, 0.005, 0.005), "tolerance")  # the default of the FMUs; it passes on its own 1e-4
done(host.setResultFile(model, ""), "results")
done(host.instantiate(model), "instantiate")
done(host.setReal(f"{one}.{given}", float(value)), given)
done(host.initialize(model), "initialize")
rows = []
for i in range(int(n)):
    if tuned and i == int(n) // 2:
        done(host.setReal(f"{one}.{tuned[0]}", float(tuned[1])), tuned[0])
    done(host.stepUntil(model, (i + 1) * h), "step")
    number, status = host.getReal(f"{one}.{wanted}")
    done(status, wanted)
    rows.append(number)
host.terminate(model)
host.delete(model)
sys.stdout.write(json.dumps(rows) + "\n")
