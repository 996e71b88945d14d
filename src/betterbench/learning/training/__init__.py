"""Training of policies on demonstrations: data, batches, the training loop, validation and curves."""
