"""Screws of the assemblies, with their threads."""

FLANGE_BOLTS = {f"hex_bolt_{i}": "M8" for i in range(1, 9)}
BOX_SCREWS = {f"din_912_m4x12_{i}": "M4" for i in range(1, 5)} | {f"screw_m3x6_{i}": "M3" for i in range(1, 5)}
