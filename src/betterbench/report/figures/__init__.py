"""Figures of a report: charts, films, images of films and the player of a trial."""
