"""Tests of the package itself: experiments, maps, faults, campaigns; no robot needs them."""
