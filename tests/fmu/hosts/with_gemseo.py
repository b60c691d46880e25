"""Runs an FMU with gemseo-fmu: python with_gemseo.py X.fmu STEP N INPUT VALUE OUTPUT."""

from __future__ import annotations

import json
import sys

from gemseo_fmu.disciplines.fmu_discipline import FMUDiscipline
from numpy import array

path, step, n, given, value, wanted = sys.argv[1:]
discipline = FMUDiscipline(
    path,
    input_names=[given],
    output_names=[wanted],
    time_step=float(step),
    final_time=int(n) * float(step),
    restart=True,
    add_time_to_output_grammar=False,
)
result = discipline.execute({given: array([float(value)])})
rows = [float(number) for number in result[wanted][1:]]  # the first is at the start
sys.stdout.write(json.dumps(rows) + "\n")
