"""Shared by all runs: domains, nodes as processes, parallel jobs, the cache of results."""
