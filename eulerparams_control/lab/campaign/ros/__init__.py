"""How the sequences of a campaign are run: over DDS in lock-step, or as processes."""
