"""Experiments: YAML files that define runs, and the code that runs and judges them."""
