"""Pages: reports on runs, and pages for calibrations, certificates, power measurements and preflight checks."""
