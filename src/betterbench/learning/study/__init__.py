"""Studies that compare how policies learn from different training data, from the plan to a page with the results.

For each arm of the study (a mixture of training distributions), policies are trained, evaluated, diagnosed and
compared.
"""
