"""The report of a run: one HTML page for those who decide, from its results file.

``document`` reads the file and makes the page of ``sections``; ``loads`` has histories and spectra of what acts;
``markup`` makes HTML of texts, tables and figures. Sentences and tables are those of the summary, which the file keeps.
"""
