"""``latin-fmu explain``: effects of a scene, what each costs, and its predicted cost; nothing else is computed.

``cost`` counts and constants, ``scene_effects`` one function per effect, ``suggestions``, ``explanation`` the report.
"""
