"""Tables of a report as HTML, CSV and LaTeX, and the tables of the BeTTER paper in the same formats."""
