#!/usr/bin/env bash
# fmuloader loads no FMU of FMI 2.0 that is for co-simulation alone: it looks up the functions of model exchange in each
# library, which the standard requires of FMUs for model exchange alone (2.0.5, section 2.1.1).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q fmuloader==0.1.2rc0 pythonfmu==0.7.0 FMPy==0.3.32
cd "$folder"
cat > gain.py <<'END_OF_PYTHON'
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Gain(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.y = 2.0 * (current_time + step_size)
        return True
END_OF_PYTHON
venv/bin/python -m pythonfmu build -f gain.py > /dev/null
venv/bin/python - <<'END_OF_PYTHON'
import sys
from importlib.metadata import version

import fmpy
from fmuloader.fmi2 import Fmi2Slave

print(f"fmuloader {version('fmuloader')}, an FMU by pythonfmu {version('pythonfmu')}")
description = fmpy.read_model_description("Gain.fmu")
print("model exchange:", description.modelExchange)
print("FMPy: y =", fmpy.simulate_fmu("Gain.fmu", stop_time=1.0, output_interval=0.5)["y"][-1])
try:
    Fmi2Slave("Gain.fmu", model_identifier=description.coSimulation.modelIdentifier)
except AttributeError as error:
    print("fmuloader:", error)
    sys.exit(0 if "undefined symbol: fmi2EnterEventMode" in str(error) else "the behaviour has changed")
sys.exit("the behaviour has changed: it is loaded")
END_OF_PYTHON
