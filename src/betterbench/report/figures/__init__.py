"""Figures of a report: charts, films, films' images and the player of a trial."""
