"""Studies: learners trained on every arm, evaluated, diagnosed and compared, from a plan to a page."""
