"""Content of mesh files in one form for all formats: nodes, solid cells, named volumes, surfaces and node sets."""
