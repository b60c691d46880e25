"""Thin finite-element layer: meshes, elastic and mass matrices, integrals over faces."""
