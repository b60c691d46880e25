"""What mesh files hold, whatever their format: nodes, solid cells, named volumes, surfaces and node sets."""
