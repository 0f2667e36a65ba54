"""The soak on its topics: the nodes as processes, and the monitor that listens."""
