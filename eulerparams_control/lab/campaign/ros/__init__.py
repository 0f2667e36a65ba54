"""Runs of the sequences of a campaign over DDS in lock-step."""
