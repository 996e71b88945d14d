"""Diagnosis: from records alone, what each policy did right or wrong and for which reason."""
