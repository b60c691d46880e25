"""What accuracy costs: quantities, refinement, error estimates, studies."""
