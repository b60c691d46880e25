"""Results of a run: quantities, datasets, files, figures and text."""
