"""Reports: a self-contained page with videos, and tables as CSV and LaTeX.

- ``pages``: the report on runs, and the pages for calibrations, certificates, power and preflight checks.
- ``headline``, ``claims``, ``outcomes``, ``task_views``: the sentences and numbers on the pages.
- ``figures``, ``tables``: charts, videos and tables on the pages.
- ``html``, ``templates``: Jinja templates and style sheets.
"""

from betterbench.report.figures.film import Film, Frame, Showing, film_key, trials_worth_showing
from betterbench.report.pages.page import write_report

__all__ = ["Film", "Frame", "Showing", "film_key", "trials_worth_showing", "write_report"]
