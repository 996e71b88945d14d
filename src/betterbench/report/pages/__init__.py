"""Pages: reports on runs, and pages for calibrations, certificates, power and preflight checks."""
