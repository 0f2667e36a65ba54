"""The control schemes: kinematic control, and what the others share with it."""
