"""What tries and proves the package: experiments, maps, faults, campaigns; no robot needs it."""
