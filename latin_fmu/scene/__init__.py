"""The scene: what the user describes, as checked data (no mesh, no operator, no solver here).

===================================  ================================================================================
schema                               `Scene`, the whole description, and its TOML text
substructures, interfaces,           its tables, one class each; checks of their keys and with other tables beside them
boundaries, laws, settings
fields                               types of the keys: strict numbers, names, faces; description, unit and range
raw_scene                            the scene as it was written, for checks with other tables
describe                             kinds, ranges and units of the keys as text; from a failed check to a message
overrides                            settings ``a.b.c=value`` on top of a file, and the lines on which keys stand
reference                            the printed reference and the JSON schema, both made from the tables
===================================  ================================================================================
"""

from __future__ import annotations
