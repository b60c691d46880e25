"""Tests of CAD assemblies as meshes and scenes."""
