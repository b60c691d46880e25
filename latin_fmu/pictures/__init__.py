"""Pictures of bodies: the assembly before a run, deformed shapes and interface pressures after it."""
