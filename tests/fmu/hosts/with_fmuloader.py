"""Runs an FMU with fmuloader: python with_fmuloader.py X.fmu STEP N INPUT VALUE OUTPUT [PARAMETER VALUE].

The parameter is set after N / 2 steps.
"""

from __future__ import annotations

import json
import sys
import zipfile
from xml.etree.ElementTree import fromstring

from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
from fmuloader.fmi3 import Fmi3Slave

path, step, n, given, value, wanted, *tuned = sys.argv[1:]
with zipfile.ZipFile(path) as archive:
    description = fromstring(archive.read("modelDescription.xml"))
references = {one.get("name"): int(one.get("valueReference", "0")) for one in description.find("ModelVariables") or ()}
model = description.find("CoSimulation").get("modelIdentifier")
if description.get("fmiVersion") == "2.0":
    slave = Fmi2Slave(path, model_identifier=model)
    slave.instantiate("one", Fmi2Type.CO_SIMULATION, guid=description.get("guid"))
    slave.setup_experiment(0.0)
    get, put = slave.get_real, slave.set_real
else:
    slave = Fmi3Slave(path, model_identifier=model)
    slave.instantiate_co_simulation("one", instantiation_token=description.get("instantiationToken"))
    get, put = slave.get_float64, slave.set_float64
slave.enter_initialization_mode()
put([references[given]], [float(value)])
slave.exit_initialization_mode()
rows = []
for i in range(int(n)):
    if tuned and i == int(n) // 2:
        put([references[tuned[0]]], [float(tuned[1])])
    slave.do_step(i * float(step), float(step))
    rows += get([references[wanted]])
slave.terminate()
slave.free_instance()
sys.stdout.write(json.dumps(rows) + "\n")
