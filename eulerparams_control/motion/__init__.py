"""Desired motion: frames, trajectories, way-points."""
