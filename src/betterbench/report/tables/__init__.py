"""Tables of a report as HTML, CSV and LaTeX, and the tables of the paper in the same forms."""
