"""The scene: what the user describes, as validated data (no operator, no mesh, no solver here).

=================  ==================================================================================
schema             `Scene`, the whole description; its tables live in materials, substructures,
                   interfaces, boundaries, loads, laws, time_settings, solver_settings, output_settings
relations          checks that span several keys or tables (unknown names, contradictions)
reader             TOML file or dictionary -> `Scene`
overrides          ``a.b.c=value`` settings applied on top of a file
reference          the printed reference and the JSON schema, both generated from the tables
=================  ==================================================================================
"""

from __future__ import annotations
