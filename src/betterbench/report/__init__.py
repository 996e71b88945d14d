"""Reports: one self-contained page, tables as CSV and LaTeX, and the films they show.

- ``pages``: the report of runs, and the pages of calibrations, certificates, power and preflight checks.
- ``headline``, ``claims``, ``outcomes``, ``task_views``: what a page says in sentences and numbers.
- ``figures``, ``tables``: charts, films and tables that pages are made of.
- ``html``, ``templates``: Jinja templates and style sheets.
"""

from betterbench.report.figures.film import Film, Frame, Showing, film_key, trials_worth_showing
from betterbench.report.pages.page import write_report

__all__ = ["Film", "Frame", "Showing", "film_key", "trials_worth_showing", "write_report"]
