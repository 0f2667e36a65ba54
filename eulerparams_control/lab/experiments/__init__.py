"""Experiments: YAML files that say all about a run, and what runs and judges them."""
