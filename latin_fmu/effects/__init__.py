"""``latin-fmu explain``: effects of a scene, what each costs, and its predicted cost; nothing else is computed.

``cost`` counts, constants and memory, ``scene_effects`` one function per effect, ``explanation`` suggestions and
report.
"""
