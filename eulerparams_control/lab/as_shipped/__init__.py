"""Laws as other packages ship them, and the nodes that run them: for experiments only."""
