"""Tests of the package itself: experiments, maps, faults; no robot needs them."""
