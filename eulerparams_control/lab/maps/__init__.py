"""Where representations fail or distort: sweeps of simulations."""
