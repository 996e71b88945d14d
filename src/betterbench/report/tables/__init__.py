"""Tables of a report as HTML, CSV and LaTeX, and the paper's tables in the same formats."""
