"""The recorder on its topics: the node, and the parameters of the nodes that it records."""
