"""Laws as other packages ship them, and the node that runs them: for experiments only."""
