"""Tables of a report, as HTML, CSV and LaTeX, and those of the paper in the same form."""
