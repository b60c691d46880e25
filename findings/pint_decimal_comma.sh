#!/usr/bin/env bash
# pint reads a decimal comma as nothing: "5,5 mm" is 55 mm, "0,25 mm" is 0 mm, without a warning.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pint==0.25.3
cd "$folder"
venv/bin/python -W error - <<'END_OF_PYTHON'
import sys
from importlib.metadata import version

import pint

units = pint.UnitRegistry()
print(f"pint {version('pint')}, texts with a decimal comma")
found = []
for text in ("5,5 mm", "0,25 mm"):
    quantity = units.Quantity(text)
    print(f"{text!r} is read as {quantity}")
    found.append(float(quantity.to("mm").magnitude))
sys.exit(0 if found == [55.0, 0.0] else "the behaviour has changed")
END_OF_PYTHON
