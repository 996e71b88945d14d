"""Pages: the report of runs, and those of calibrations, certificates, power and preflight checks."""
