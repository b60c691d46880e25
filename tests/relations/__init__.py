"""Relations between runs that must agree, on random scenes and shipped models."""
