"""Reports: one self-contained page, tables as CSV and LaTeX, and the films they show."""

from betterbench.report.film import Film, Frame, Showing, film_key, trials_worth_showing
from betterbench.report.page import write_report

__all__ = ["Film", "Frame", "Showing", "film_key", "trials_worth_showing", "write_report"]
