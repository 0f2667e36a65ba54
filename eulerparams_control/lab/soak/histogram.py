"""Latencies of any number in bounded memory: counts in bins that grow by one hundredth."""

import math

import numpy as np

_LEAST, _DECADES, _PER_DECADE = 1e-6, 8, 232  # from 1 us to 100 s; 10^(1/232) is 1.01


class Histogram:
    """Counts of times [s]; a percentile is right within one hundredth of it."""

    def __init__(self) -> None:
        self._counts = np.zeros(_DECADES * _PER_DECADE + 1, dtype=np.int64)
        self.largest = 0.0

    def __len__(self) -> int:
        return int(self._counts.sum())

    def add(self, seconds: float) -> None:
        """Count one time [s]."""
        place = math.log10(max(seconds, _LEAST) / _LEAST) * _PER_DECADE
        self._counts[min(int(place), len(self._counts) - 1)] += 1
        self.largest = max(self.largest, seconds)

    def merge(self, other: "Histogram") -> None:
        """Count all that another one has counted."""
        self._counts += other._counts
        self.largest = max(self.largest, other.largest)

    def percentile(self, p: float) -> float:
        """Return the time [s] below which p percent are; NaN if there are none."""
        total = len(self)
        if not total:
            return math.nan
        wanted = max(1, math.ceil(total * p / 100))
        place = int(np.searchsorted(np.cumsum(self._counts), wanted))
        return float(_LEAST * 10 ** ((place + 0.5) / _PER_DECADE))
