"""Laws that are not yet open Python, and what they are written in."""
